"""The command line: quick to help, one line when it fails, exit codes as promised, nothing heavy loaded."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import rig.cli
import rig.commands.run
from analysis.errors import BadInputError
from rig.cli import main
from rig.engine.interrupts import Interrupted
from rig.errors import RigError

COMMANDS = [
    "demo",
    "run",
    "calibrate",
    "import",
    "fit",
    "diagnose",
    "prove",
    "export",
    "rescue",
    "discard",
    "watch",
]


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(command in said for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    assert command in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("indenter ")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (BadInputError("x.toml: depth\nis wrong"), 2),
        (RigError("the arm is\nstuck"), 1),
        (Interrupted("stopped by the operator"), 130),
        (KeyboardInterrupt(), 130),
    ],
)
def test_exit_codes_and_one_line(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(rig.commands.run, "run_protocol_file", fail)
    assert main(["run", "x.toml"]) == code
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_examples_are_written_and_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "files"
    assert main(["run", "--example", str(folder)]) == 0
    assert {"rig.toml", "simulated_rig.toml", "study.toml"} <= {p.name for p in folder.iterdir()}
    assert main(["run", "--example", str(folder)]) == 2, "what stands there is not overwritten"


def _seconds(argv: list[str]) -> float:
    began = time.perf_counter()
    subprocess.run(argv, check=True, capture_output=True)
    return time.perf_counter() - began


def test_help_is_quick() -> None:
    # 0.12 s on a quiet computer; the bound holds on one that is kept busy by others
    assert min(_seconds([sys.executable, "-m", "rig.cli", "--help"]) for _ in range(5)) < 1.0


@pytest.mark.benchmark
def test_help_time() -> None:
    times = sorted(_seconds([sys.executable, "-m", "rig.cli", "--help"]) for _ in range(11))
    print(f"\nindenter --help: median {times[5]:.3f} s, fastest {times[0]:.3f} s (limit 0.3 s)")


def _loaded(code: str) -> set[str]:
    listing = "; import sys; print('\\n'.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code + listing], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.splitlines()}


def test_help_loads_nothing_heavy() -> None:
    loaded = _loaded("from rig.cli import main; main(['--help'])")
    heavy = {"matplotlib", "numba", "rich", "pydantic", "h5py", "scipy", "nidaqmx", "grpc", "zmq", "jinja2"}
    assert not loaded & heavy


def test_no_window_toolkit_in_a_headless_run() -> None:
    loaded = _loaded("import rig.commands.run, rig.commands.calibrate, rig.commands.watch, rig.commands.demo")
    assert not loaded & {"PySide6", "PyQt5", "PyQt6", "pyqtgraph"}


@pytest.mark.skipif(sys.platform == "win32", reason="descriptors are handed on by number on POSIX alone")
def test_a_program_without_standard_streams_runs_all_the_same(tmp_path):
    """As a service may start it: nothing that it opens may take the place of one of them."""
    (tmp_path / "one.toml").write_text('kind = "air_sweep"\n')
    command = f'"{sys.executable}" -m rig.cli run "{tmp_path}/one.toml" --out "{tmp_path}/out" <&- >&- 2>&-'
    assert subprocess.run(command, shell=True, check=False, timeout=120).returncode == 0
    assert list((tmp_path / "out").glob("*.h5"))
