"""The way to NI's gRPC device server, where the card is in another computer."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import grpc

from rig.hardware.errors import CardMissingError
from rig.settings.rig_file import TlsSettings

_CHANNEL_OPTIONS = (("grpc.enable_http_proxy", 0),)
"""A card is in the laboratory's own network: a web proxy between would only add time and failures."""

DEADLINE_S = 30.0
"""No call takes that long: reads are short. A server that hangs is told, not waited for."""


def open_channel(address: str, tls: TlsSettings | None = None) -> grpc.Channel:
    """Open the way to the server at "host:port"; it connects with the first call.

    With ``tls`` both sides prove who they are. Raises CardMissingError where its files can't be read.
    """
    if tls is None:
        way = grpc.insecure_channel(address, options=_CHANNEL_OPTIONS)
    else:
        credentials = grpc.ssl_channel_credentials(
            root_certificates=_read(tls.authority),
            private_key=_read(tls.key),
            certificate_chain=_read(tls.certificate),
        )
        way = grpc.secure_channel(address, credentials, options=_CHANNEL_OPTIONS)
    return grpc.intercept_channel(way, _Deadline())


def _read(file: str) -> bytes:
    try:
        return Path(file).read_bytes()
    except OSError as error:
        raise CardMissingError(
            f"{file}: can't be read ({error.strerror}); check [card.tls] in rig.toml"
        ) from error


class _Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
    """Gives every call a deadline, which the driver's client leaves out."""

    def intercept_unary_unary(self, continuation: Any, details: Any, request: Any) -> Any:
        """Pass the call on with a deadline."""
        return continuation(_CallDetails(details.method, details.metadata, details.credentials), request)


class _CallDetails(NamedTuple):
    """What a call is made with; only the deadline is not the caller's."""

    method: str
    metadata: Any
    credentials: Any
    timeout: float = DEADLINE_S
    wait_for_ready: bool | None = None
    compression: Any = None
