"""Stage and balance: the exact bytes on the wire, and what is made of the answers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from rig.hardware.balance import Balance
from rig.hardware.errors import SerialDeviceError
from rig.hardware.stage import Stage
from rig.settings.rig_file import BalanceSettings, StageSettings


class ScriptedDevice:
    """A device behind a TCP port: expects exactly these bytes, one after the other, and answers these."""

    def __init__(self, script: list[tuple[bytes, bytes]]) -> None:
        self.heard: list[bytes] = []
        self._script = script
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self._server.accept()
        with connection:
            connection.settimeout(5.0)
            for expected, answer in self._script:
                self.heard.append(connection.recv(len(expected)) if expected else b"")
                connection.sendall(answer)
            self.heard.append(connection.recv(100))

    def close(self) -> None:
        self._thread.join()
        self._server.close()

    def check(self) -> None:
        """The device heard the script and nothing else."""
        assert self.heard == [expected for expected, _ in self._script] + [b""]


@pytest.fixture
def device() -> Iterator[Callable[[list[tuple[bytes, bytes]]], ScriptedDevice]]:
    made: list[ScriptedDevice] = []

    def scripted(script: list[tuple[bytes, bytes]]) -> ScriptedDevice:
        made.append(ScriptedDevice(script))
        return made[-1]

    yield scripted
    for one in made:
        one.close()


class CountingClock:
    def __init__(self) -> None:
        self.slept_s = 0.0

    def time_s(self) -> float:
        return self.slept_s

    def sleep(self, duration_s: float) -> None:
        self.slept_s += duration_s


STILL = b"@01 0 OK IDLE -- 0\r\n"
MOVING = b"@01 0 OK BUSY -- 0\r\n"
LOST = b"@01 0 OK IDLE WR 0\r\n"


def test_a_move_is_sent_in_microsteps_and_waited_for(device: Callable[..., ScriptedDevice]) -> None:
    at = device(
        [
            (b"/1\n", STILL),
            (b"/1\n", STILL),
            (b"/1 move abs 16798\n", MOVING),
            (b"/1\n", MOVING),
            (b"/1\n", b"#01 0 cnt\r\n!01 0 IDLE --\r\n" + MOVING),
            (b"/1\n", STILL),
            (b"/1 get pos\n", b"@01 0 OK IDLE -- 16798\r\n"),
        ]
    )
    clock = CountingClock()
    with Stage(StageSettings(port=at.port), at.port, clock) as stage:
        stage.move_to_um(800.0)
        assert stage.position_um == pytest.approx(800.0, abs=0.05)
    at.close()
    at.check()
    assert clock.slept_s == pytest.approx(0.1)


def test_a_stage_without_reference_is_homed_first(device: Callable[..., ScriptedDevice]) -> None:
    at = device(
        [
            (b"/2\n", b"@02 0 OK IDLE WR 0\r\n"),
            (b"/2\n", b"@02 0 OK IDLE WR 0\r\n"),
            (b"/2 home\n", b"@02 0 OK BUSY WR 0\r\n"),
            (b"/2\n", b"@02 0 OK IDLE -- 0\r\n"),
            (b"/2 move abs 160\n", b"@02 0 OK BUSY -- 0\r\n"),
            (b"/2\n", b"@02 0 OK IDLE -- 0\r\n"),
        ]
    )
    settings = StageSettings(port=at.port, device_number=2, microstep_um=1.0)
    with Stage(settings, at.port, CountingClock()) as stage:
        stage.move_to_um(160.0)
    at.close()
    at.check()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"@01 0 RJ IDLE -- BADDATA\r\n", "rejected '/1 move abs 21': BADDATA"),
        (b"@02 0 OK IDLE -- 0\r\n", "no reply of device 1"),
        (b"what?\r\n", "no reply of device 1"),
        (b"\xff\xfe\r\n", "no reply of device 1"),
    ],
)
def test_a_stage_that_says_something_else_is_told(
    device: Callable[..., ScriptedDevice], answer: bytes, words: str
) -> None:
    at = device([(b"/1\n", STILL), (b"/1\n", STILL), (b"/1 move abs 21\n", answer)])
    with (
        Stage(StageSettings(port=at.port), at.port, CountingClock()) as stage,
        pytest.raises(SerialDeviceError, match="check its cable") as caught,
    ):
        stage.move_to_um(1.0)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_stage_that_never_arrives_is_told(device: Callable[..., ScriptedDevice]) -> None:
    at = device([(b"/1\n", STILL), (b"/1 home\n", MOVING)] + [(b"/1\n", MOVING)] * 2403)
    with (
        Stage(StageSettings(port=at.port), at.port, CountingClock()) as stage,
        pytest.raises(SerialDeviceError, match="still moves"),
    ):
        stage.home()


def test_a_balance_is_zeroed_and_weighs(device: Callable[..., ScriptedDevice]) -> None:
    at = device(
        [
            (b"SI\r\n", b"S D      0.0312 g\r\n"),
            (b"Z\r\n", b"Z A\r\n"),
            (b"S\r\n", b"S S      5.0000 g\r\n"),
            (b"S\r\n", b"S S     -0.1250 g\r\n"),
        ]
    )
    with Balance(BalanceSettings(port=at.port), at.port) as balance:
        balance.zero()
        assert balance.weigh_g() == 5.0
        assert balance.weigh_g() == -0.125
    at.close()
    at.check()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"S I\r\n", "is busy"),
        (b"S +\r\n", "is overloaded"),
        (b"S -\r\n", "is underloaded"),
        (b"ES\r\n", "does not know the command"),
        (b"S S      5.0000 lb\r\n", "set it to grams"),
        (b"S D      5.0000 g\r\n", "answered 'S D      5.0000 g'"),
        (b"", "did not answer in time"),
    ],
)
def test_a_balance_that_does_not_weigh_is_told(
    device: Callable[..., ScriptedDevice], answer: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.hardware.balance._STABLE_S", 0.2)
    at = device([(b"SI\r\n", b"S S      0.0000 g\r\n"), (b"S\r\n", answer)])
    with (
        Balance(BalanceSettings(port=at.port), at.port) as balance,
        pytest.raises(SerialDeviceError) as caught,
    ):
        balance.weigh_g()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("port", ["socket://127.0.0.1:9", "/dev/no-such-port", "nonsense://x"])
def test_a_port_that_cannot_be_opened_is_told(port: str) -> None:
    with pytest.raises(SerialDeviceError, match="can't be opened") as caught:
        Balance(BalanceSettings(port=port), port)
    assert "\n" not in str(caught.value)
