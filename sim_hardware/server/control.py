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
from sim_hardware.instruments.balance import Balance

BAD_REQUEST = 2


class Bench(Plant, Protocol):
    """The world as its operator meets it."""

    def request(self, kind: str, details: Mapping[str, Any]) -> str:
        """Let the operator's hands do something; ValueError for what they can't."""

    def arm(self) -> Any:
        """Where the arm is and what it feels."""

    def truth(self) -> Any:
        """The true constants drawn for this bench."""


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


def _number(details: Mapping[str, Any], name: str, *, least: float) -> float:
    """A number of a request; ValueError that names it where it is missing, no number or too small."""
    value = details.get(name)
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
        """Order a fault now: `unplug`, `replug`, `stall`, `coerce_rate`, `late_start`."""
        order_fault(self._card, kind, details)()
        return f"{kind} done"


def order_fault(card: Card, kind: str, details: Mapping[str, Any]) -> Callable[[], None]:
    """What makes the fault happen; ValueError for an unknown kind or a bad detail.

    Kinds: `unplug` and `replug` {}; `stall` {duration_s}; `coerce_rate` {rate_hz} (0: no longer);
    `late_start` {samples}.
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
    raise ValueError(f"unknown fault {kind!r}: unplug, replug, stall, coerce_rate or late_start")


class _RequestHandler(SimpleXMLRPCRequestHandler):
    protocol_version = "HTTP/1.1"  # a clock that is asked often keeps its connection


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
