"""Files that are nearly right: each is taken, or refused in one clear line, within two seconds.

The campaign of 1,000 is marked slow; a tenth of it runs always. Seeded: no false failures but for time.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import psutil
import pytest

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from rig.calibration.kept import newest_calibration
from rig.engine.requests import Verdict, make_request, parse_request, sealed
from rig.protocols.fitting import check_fits, check_number
from rig.protocols.planning import plan_of
from rig.settings.reading import check_protocol_on_rig, parse_protocol, parse_rig
from rig.settings.rig_file import RigFile

PROTOCOLS = (
    "air_sweep", "force_calibration", "position_calibration", "ramp_hold_retract",
    "rigid_target", "study", "surface_detection",
)  # fmt: skip
ODD = (
    "-1", "0", "1e-9", "1e9", "1e308", "nan", "inf", "-inf", "true", '"text"', '""', "[]", "{}", "1e-6", "86400.0",
    "[1e-9, 1e9]", '"\\u001b[31m"', "99999999999999999999", "0x7f", "1979-05-27", "'../../etc/passwd'", "",
)  # fmt: skip
RAW = (b"\x00", b"\xff\xfe", b"[[", b"\x1b[2J", b"=" * 50, b"\n" * 3, b'"' * 3)
SEAL = b"\nindenter-crc32 00000000\n"
LIMIT_S = 2.0


def example(name: str) -> str:
    return (files("rig.examples") / f"{name}.toml").read_text(encoding="utf-8")


def mangled(text: str, random: np.random.Generator) -> str:
    """A file with one to four values, keys or bytes that are not as they were."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    for _ in range(int(random.integers(1, 4))):
        i = int(random.integers(len(lines)))
        key, sign, value = lines[i].partition("=")
        match int(random.integers(12)):
            case 0 | 1 | 2 | 3 | 4 if sign and value.split("#")[0].strip().replace(".", "").isdigit():
                lines[i] = f"{key}= {float(value.split('#')[0]) * 10 ** random.uniform(-2, 2):.6g}"
            case 5 | 6 if sign:
                lines[i] = f"{key}= {ODD[int(random.integers(len(ODD)))]}"
            case 7 if sign:
                lines[i] = f"{key.strip()[:-1]} = {value}"
            case 8:
                lines[i] = lines[i][: int(random.integers(len(lines[i]) + 1))]
            case 9:
                lines.insert(i, lines[int(random.integers(len(lines)))])
            case 10:
                lines[i] += RAW[int(random.integers(len(RAW)))].decode("latin-1")
    return "\n".join(lines) + "\n"


took_each_s: list[float] = []
"""What each file took."""


def worked_s() -> float:
    """What this thread, and the processes that read for it, have used of a processor, s.

    Other jobs share the computer, and reading a file waits for nothing else.
    """
    ended = os.times()
    spent_s = time.thread_time() + ended.children_user + ended.children_system
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            spent_s += sum(child.cpu_times()[:2])
    return spent_s


def judged(number: int, work: Callable[[], object]) -> bool:
    """Whether it was taken; a refusal must be one line, and either must be quick."""
    began_s = worked_s()
    try:
        work()
        taken = True
    except BadInputError as error:
        taken = False
        assert "\n" not in str(error), number
        assert 10 < len(str(error)) < 1500, (number, str(error)[:200])
    took_s = worked_s() - began_s
    assert took_s < LIMIT_S, number
    took_each_s.append(took_s)
    return taken


def protocols(n: int, random: np.random.Generator, folder: Path) -> int:
    def work(text: str) -> None:
        protocol = parse_protocol(text, "protocol.toml")
        check_protocol_on_rig(protocol, RigFile(), "protocol.toml")
        check_number(protocol, "protocol.toml")
        check_fits(plan_of(protocol, 0.5, text), RigFile(), folder, "protocol.toml")

    return sum(
        judged(i, lambda i=i: work(mangled(example(PROTOCOLS[i % len(PROTOCOLS)]), random))) for i in range(n)
    )


def rigs(n: int, random: np.random.Generator) -> int:
    names = ("rig", "simulated_rig")
    return sum(
        judged(i, lambda i=i: parse_rig(mangled(example(names[i % 2]), random), "rig.toml")) for i in range(n)
    )


def calibrations(n: int, random: np.random.Generator, folder: Path) -> int:
    measured = {"se": 1e-5, "dof": 5}
    whole = {
        "format": "indenter-calibration",
        "format_version": 1,
        "kind": "force",
        "rig": "",
        "units": "V, V/mm, V/mN",
        "calibrated": "2026-01-05T10:00:00+00:00",
        "valid_until": "2026-12-01T10:00:00+00:00",
        "constants": {"volts_per_mn": {"value": 0.015} | measured, "force_zero_v": {"value": 0.0} | measured},
    }
    text = json.dumps(whole, indent=1)
    odd = ("null", "-1", "1e400", "NaN", '"x"', "[]", "{}", "0.15", "-0.015", '"2999-01-01"', "")

    def work() -> None:
        lines = text.splitlines()
        for _ in range(int(random.integers(1, 4))):
            i = int(random.integers(len(lines)))
            key, sign, _ = lines[i].partition(":")
            lines[i] = f"{key}: {odd[int(random.integers(len(odd)))]}," if sign else lines[i][:-1]
        (folder / "force.json").write_text("\n".join(lines), encoding="utf-8")
        newest_calibration(RigFile(), folder)

    return sum(judged(i, work) for i in range(n))


def trial_files(n: int, random: np.random.Generator, folder: Path) -> int:
    from analysis.recordings import TrialHeader, TrialWriter
    from rig.settings.rig_file import CalibrationSettings

    header = TrialHeader("ramp_hold_retract", "simulated", 8000.0, CalibrationSettings().nominal())
    with TrialWriter(folder / "whole.h5", header, 400) as writer:
        writer.append(*random.normal(size=(3, 400)))
    whole = (folder / "whole.h5").read_bytes()
    # a stranger's carries no seal: what is wrong with it must be found in reading it
    bare = whole[: -len(SEAL)]
    path = folder / "t.h5"

    def work() -> None:
        contents = whole if random.random() < 0.2 else bare
        match int(random.integers(5)):
            case 0:
                path.write_bytes(contents[: int(random.integers(len(contents)))])
            case 1 | 2 | 3:
                changed = bytearray(contents)
                for at in random.integers(len(changed), size=int(random.integers(1, 8))):
                    changed[at] = int(random.integers(256))
                path.write_bytes(changed)
            case _:
                path.write_bytes(contents)
                with h5py.File(path, "r+") as file:
                    name = ("signals/force_v", "phases", "calibration", "log")[int(random.integers(4))]
                    del file[name]
                    file[name] = h5py.ExternalLink("/etc/passwd", "/x")
        read_trial(path)

    return sum(judged(i, work) for i in range(n))


def requests(n: int, random: np.random.Generator) -> int:
    """Messages of somebody who has the token: nearly right, and answered whatever they hold."""
    asked = [
        make_request("stop"),
        make_request("skip", what="trial"),
        make_request("discard", file="001.h5", reason="it moved"),
        make_request("answer", prompt="p1", answer="done", value=1.5),
        make_request("run", protocol="study.toml", out="study"),
    ]

    def work() -> None:
        message = bytearray(sealed(asked[int(random.integers(len(asked)))], "token"))
        for _ in range(int(random.integers(1, 4))):
            at = int(random.integers(len(message)))
            match int(random.integers(4)):
                case 0:
                    message[at] = int(random.integers(256))
                case 1:
                    message[at:at] = RAW[int(random.integers(len(RAW)))]
                case 2:
                    message[at:at] = ODD[int(random.integers(len(ODD)))].encode() * int(
                        random.integers(1, 999)
                    )
                case _:
                    del message[at : at + int(random.integers(1, 9))]
        heard = parse_request(bytes(message), "token")
        if heard is None:
            raise BadInputError("a stranger's message: not answered")
        if isinstance(heard, Verdict):
            assert len(heard.why) <= 300
            raise BadInputError(f"refused: {heard.why}")

    return sum(judged(i, work) for i in range(n))


@pytest.mark.parametrize("share", [0.1, pytest.param(1.0, marks=pytest.mark.slow)])
def test_files_that_are_nearly_right(tmp_path: Path, share: float) -> None:
    random = np.random.default_rng(20)
    taken = {
        "protocols": protocols(round(350 * share), random, tmp_path),
        "rigs": rigs(round(200 * share), random),
        "calibrations": calibrations(round(150 * share), random, tmp_path),
        "requests": requests(round(150 * share), random),
        "trial files": trial_files(round(150 * share), random, tmp_path),
    }
    # that most are refused says something only where some are not
    assert taken["trial files"] >= 20 * share - 2
    print(f"\n{len(took_each_s)} files, taken as good: {taken}; the longest took {max(took_each_s):.2f} s")
