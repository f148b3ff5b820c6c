"""The companion, the control service and the operator at the console."""

from __future__ import annotations

import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from rig.hardware.clock import RemoteClock, SystemClock
from rig.hardware.companion import Companion
from rig.hardware.errors import CompanionError, OperatorError
from rig.hardware.operator import RemoteOperator, words_for
from rig.hardware.remote import ControlService
from rig.settings.rig_file import CompanionSettings


@pytest.fixture
def companion_of(tmp_path: Path) -> Callable[..., Companion]:
    def made(program: str, **options: Any) -> Companion:
        script = tmp_path / "companion.py"
        script.write_text(textwrap.dedent(program))
        return Companion(CompanionSettings(command=("{python}", str(script)), **options))

    return made


ECHO = """
    import json, sys, tomllib
    lines = []
    for line in sys.stdin:
        if line == "# end\\n":
            break
        lines.append(line)
    settings = tomllib.loads("".join(lines))
    print(json.dumps({"card": json.dumps(settings, sort_keys=True), "python": sys.executable}), flush=True)
    sys.stdin.read()
"""


def test_it_is_handed_its_settings_and_says_where_it_is(companion_of: Callable[..., Companion]) -> None:
    settings = {
        "seed": 1,
        "tissue": {"k0_mn_per_mm": 120.5},
        "effects": ({"name": "adhesion"}, {"name": "x"}),
    }
    with companion_of(ECHO, settings=settings) as companion:
        assert companion.resolve("companion:card") == (
            '{"effects": [{"name": "adhesion"}, {"name": "x"}], "seed": 1, "tissue": {"k0_mn_per_mm": 120.5}}'
        )
        assert companion.resolve("companion:python") == sys.executable
        assert companion.resolve("COM3") == "COM3"
        with pytest.raises(CompanionError, match="offers only card, python"):
            companion.resolve("companion:stage")
        process = companion._process
        assert process is not None
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("import sys; sys.exit('seed = -1: must not be negative')", "(exit code 1): seed = -1"),
        ("raise RuntimeError('no such thing')", "RuntimeError: no such thing"),
        ("print('hello', flush=True); input()", "no table of addresses: b'hello"),
        ("print('[1]', flush=True); input()", "no table of addresses"),
        ("import time; time.sleep(60)", "said nothing within 0.5 s"),
    ],
)
def test_a_companion_that_does_not_start_is_told_in_one_line(
    companion_of: Callable[..., Companion], program: str, words: str
) -> None:
    patience_s = 0.5 if "sleep" in program else 30.0
    with (
        pytest.raises(CompanionError) as caught,
        companion_of(program, start_timeout_s=patience_s),
    ):
        pass
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_program_that_is_not_there_is_told() -> None:
    with (
        pytest.raises(CompanionError, match=r"could not be started .*check companion\.command"),
        Companion(CompanionSettings(command=("no-such-program",))),
    ):
        pass


class Service:
    """The control service's methods, as a bench would serve them."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.requests: list[tuple[str, dict[str, Any]]] = []

    def time_s(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> bool:
        self.now_s += duration_s
        return True

    def request(self, kind: str, details: dict[str, Any]) -> str:
        if kind == "juggle":
            raise ValueError("nobody can")
        self.requests.append((kind, details))
        return "done"


@pytest.fixture
def service() -> Iterator[tuple[Service, str]]:
    served = Service()
    server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
    server.register_instance(served)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield served, f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_hands_and_clock_are_those_of_the_service(service: tuple[Service, str]) -> None:
    served, address = service
    control = ControlService(address)
    clock, hands = RemoteClock(control), RemoteOperator(control)
    assert clock.time_s() == 100.0
    clock.sleep(7200.0)
    clock.sleep(-1.0)
    assert clock.time_s() == 7300.0
    assert hands.request("hang_weight", {"mass_g": 5.0}) == "done"
    assert served.requests == [("hang_weight", {"mass_g": 5.0})]
    with pytest.raises(OperatorError, match=r"request refused: .*nobody can") as caught:
        hands.request("juggle", {})
    assert "\n" not in str(caught.value)
    control.close()


def test_a_service_that_is_not_there_is_told() -> None:
    with pytest.raises(OperatorError, match="does not answer") as caught:
        RemoteClock(ControlService("http://127.0.0.1:9")).time_s()
    assert "\n" not in str(caught.value)


def test_the_systems_clock_goes_on() -> None:
    clock = SystemClock()
    before_s = clock.time_s()
    clock.sleep(0.02)
    clock.sleep(-1.0)
    assert 0.02 <= clock.time_s() - before_s < 5.0


def test_every_request_has_words() -> None:
    assert words_for("clear_air", {}) == "Clear everything from below the arm"
    assert words_for("sweep_floor", {"rooms": 2}) == "sweep floor: rooms 2"
    assert words_for("hang_weight", {"mass_g": 5.0}) == "Hang 5 g from the arm by a rubber band"
    assert words_for("hang_weight", {"mass_g": 0.0}) == "Take all weights off the arm"
    assert words_for("place_on_balance", {"mass_g": 0.0}) == "Clear the pan of the balance"
    assert words_for("invert_arm", {"inverted": True}) == "Turn the arm over"
    assert words_for("invert_arm", {"inverted": False}) == "Turn the arm back, upright"
