"""The way to NI's gRPC device server, where the card is in another computer."""

from __future__ import annotations

from typing import Any, NamedTuple

import grpc

_CHANNEL_OPTIONS = (("grpc.enable_http_proxy", 0),)
"""A card is in the laboratory's own network: a web proxy between would only add time and failures."""

DEADLINE_S = 30.0
"""No call takes that long: reads are short. A server that hangs is told, not waited for."""


def open_channel(address: str) -> grpc.Channel:
    """Open the way to the server at "host:port"; it connects with the first call."""
    plain = grpc.insecure_channel(address, options=_CHANNEL_OPTIONS)
    return grpc.intercept_channel(plain, _Deadline())


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
