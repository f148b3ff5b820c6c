"""Calls to a control service (XML-RPC) that stands in for the clock on the wall and the operator's hands."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any

from rig.hardware.errors import OperatorError

_TIMEOUT_S = 120.0
"""No request of a hand or a clock is answered later: whoever asks waits with the arm clear, and not for ever."""


class _Transport(xmlrpc.client.Transport):
    """The client's way to the service, with an end to every wait."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Connect with a timeout, which the library leaves out."""
        connection = super().make_connection(host)
        connection.timeout = _TIMEOUT_S
        return connection


class ControlService:
    """A control service; one user at a time.

    ``address``: http://host:port.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._proxy = xmlrpc.client.ServerProxy(
            address, allow_none=True, transport=_Transport() if address.startswith("http:") else None
        )

    def call(self, method: str, *arguments: Any) -> Any:
        """Call a method; OperatorError, in one line, where the service refuses or does not answer."""
        try:
            return self._call(method, *arguments)
        except xmlrpc.client.Fault as fault:
            said = (
                fault.faultString.strip().splitlines()[-1] if fault.faultString.strip() else "no reason given"
            )
            raise OperatorError(f"control service {self.address}: {method} refused: {said}") from fault
        except (OSError, http.client.HTTPException, xmlrpc.client.Error) as error:
            raise OperatorError(
                f"control service {self.address} does not answer ({error}); start it, or take [operator] and "
                "[clock] out of rig.toml"
            ) from error

    def _call(self, method: str, *arguments: Any) -> Any:
        try:
            return getattr(self._proxy, method)(*arguments)
        except KeyboardInterrupt:
            # an answer still on its way would be taken for that of the next call
            self.close()
            raise

    def close(self) -> None:
        """Close the connection."""
        self._proxy("close")()
