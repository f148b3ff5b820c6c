"""The bench's control service (XML-RPC): its clock, the operator's hands, faults, the hidden truth."""

import dataclasses
import threading
from collections.abc import Callable, Mapping
from socketserver import ThreadingMixIn
from typing import Any, Protocol
from xmlrpc.client import Fault
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import numpy as np

from sim_hardware.card import Card
from sim_hardware.card.plant import Plant
from sim_hardware.card.wires import INPUT_OF_LINE, Wire
from sim_hardware.instruments.balance import Balance

BAD_REQUEST = 2
LONGEST_CALL_BYTES = 65536


class Bench(Plant, Protocol):
    """The world as its operator meets it."""

    def request(self, kind: str, details: Mapping[str, Any]) -> str:
        """Let the operator's hands do something; ValueError for what they can't."""

    def arm(self) -> Any:
        """Where the arm is and what it feels."""

    def truth(self) -> Any:
        """The true constants drawn for this bench."""

    def largest_force_mn(self) -> float:
        """The largest force on the punch since the last call, mN."""


def plain(value: Any) -> Any:
    """`value` in the types that XML-RPC carries; integers beyond 32 bits become text."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, int) and not isinstance(value, bool) and not -(2**31) <= value < 2**31:
        return str(value)
    return value


def _number(details: Mapping[str, Any], name: str, *, least: float, default: float | None = None) -> float:
    """A number of a request; ValueError that names it where it is missing, no number or too small."""
    value = details.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < 1e9:
        raise ValueError(f"{name} = {value!r}: a number from {least:g} is needed")
    return float(value)


class Control:
    """The calls of the service; all times in seconds of the bench."""

    def __init__(self, card: Card, bench: Bench, balance: Balance) -> None:
        self._card = card
        self._bench = bench
        self._balance = balance

    def time_s(self) -> float:
        """The bench's clock."""
        return self._card.now_s()

    def sleep(self, duration_s: float) -> float:
        """Let time pass, really or by a jump; the time afterwards."""
        self._card.sleep(_number({"duration_s": duration_s}, "duration_s", least=0.0))
        return self.time_s()

    def request(self, kind: str, details: dict[str, Any]) -> str:
        """The operator's hands: the world's requests, and `place_on_balance` {mass_g} (0 clears the pan)."""
        if kind == "place_on_balance":
            mass_g = _number(details, "mass_g", least=0.0)
            self._balance.put(mass_g)
            return f"{mass_g:g} g on the balance" if mass_g else "balance cleared"
        with self._card.at_now():
            return self._bench.request(kind, details)

    def arm(self) -> Any:
        """Where the arm is now, with what is on its command line and the time."""
        with self._card.at_now():
            return plain(self._bench.arm())

    def truth(self) -> Any:
        """The true constants, for tests and scoring only."""
        with self._card.at_now():
            return plain(self._bench.truth())

    def fault(self, kind: str, details: dict[str, Any]) -> str:
        """Order a fault now: `unplug`, `replug`, `stall`, `coerce_rate`, `late_start`, `wire`, `mend`."""
        order_fault(self._card, kind, details)()
        return f"{kind} done"

    def largest_force(self) -> Any:
        """The largest true force on the punch since this was asked last, mN, with no sensor between."""
        with self._card.at_now():
            return plain(self._bench.largest_force_mn())


def order_fault(card: Card, kind: str, details: Mapping[str, Any]) -> Callable[[], None]:
    """What makes the fault happen; ValueError for an unknown kind or a bad detail.

    Kinds: `unplug` and `replug` {}; `stall` {duration_s}; `coerce_rate` {rate_hz} (0: no longer);
    `late_start` {samples}; `wire` {line, gain, offset_v, low_v, high_v}: what an input (position, force or
    loopback) reads from now on of what is sent to it; `mend` {}: all wires are whole again.
    """
    if kind in {"unplug", "replug"}:
        return card.unplug if kind == "unplug" else card.replug
    if kind == "stall":
        duration_s = _number(details, "duration_s", least=0.0)
        return lambda: card.stall(duration_s)
    if kind == "coerce_rate":
        rate_hz = _number(details, "rate_hz", least=0.0)
        return lambda: setattr(card, "coerced_rate_hz", rate_hz or None)
    if kind == "late_start":
        samples = int(_number(details, "samples", least=0))
        return lambda: setattr(card, "late_start_samples", samples)
    if kind == "wire":
        line = details.get("line")
        if line not in INPUT_OF_LINE:
            raise ValueError(f"line = {line!r}: one of {', '.join(INPUT_OF_LINE)} is needed")
        whole = Wire()
        values = {
            name: _number(details, name, least=-1e6, default=getattr(whole, name))
            for name in ("gain", "offset_v", "low_v", "high_v")
        }
        return lambda: card.wires.update({INPUT_OF_LINE[line]: Wire(**values)})
    if kind == "mend":
        return card.wires.clear
    raise ValueError(f"unknown fault {kind!r}: unplug, replug, stall, coerce_rate, late_start, wire or mend")


class _RequestHandler(SimpleXMLRPCRequestHandler):
    """Hears programs of this computer only: a page in a browser can send a call here, but not such a one.

    A page reaches this port under its own host name, and may not say that it sends XML.
    """

    protocol_version = "HTTP/1.1"  # a clock that is asked often keeps its connection

    def do_POST(self) -> None:  # noqa: N802 - the server's name for it
        """Answer a call, unless its head says that it is no program's."""
        port = self.server.server_address[1]  # type: ignore[index]
        content = self.headers.get_content_type()
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Host") not in {f"127.0.0.1:{port}", f"localhost:{port}"}:
            self._refuse(403, "calls from other hosts are refused")
        elif content not in {"text/xml", "application/xml"}:
            self._refuse(415, f"{content}: a call is text/xml")
        elif not length.isdecimal() or int(length) > LONGEST_CALL_BYTES:
            self._refuse(413, f"a call says its length and has {LONGEST_CALL_BYTES} bytes at most")
        else:
            super().do_POST()

    def _refuse(self, status: int, reason: str) -> None:
        self.close_connection = True
        self.send_error(status, reason)


class ControlServer(ThreadingMixIn, SimpleXMLRPCServer):
    """Serves the control calls on the loopback interface."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, control: Control, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _RequestHandler, logRequests=False, allow_none=True)
        self.register_instance(control)

    def _dispatch(self, method: str, params: Any) -> Any:
        try:
            return super()._dispatch(method, params)
        except (ValueError, TypeError, KeyError) as error:
            raise Fault(BAD_REQUEST, f"{method}: {error}") from None

    @property
    def address(self) -> str:
        """Where an XML-RPC client finds it."""
        return f"http://127.0.0.1:{self.server_address[1]}"

    def start(self) -> None:
        """Serve in the background until `shutdown`."""
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()
