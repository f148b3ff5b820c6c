"""Breaks of the safety code, one at a time, each in a copy of the project: a test must fail on every one.

    python tests/rig/safety/breaks.py [NAME...]

Prints a line a break and ends with 1 where one was not noticed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[3]
_COPIED = ("rig", "analysis", "sim_hardware", "tests", "pyproject.toml")
SAFETY = "tests/rig/safety/"


@dataclass(frozen=True)
class Break:
    """A text of a file that is replaced by another, and the tests that must notice."""

    name: str
    file: str
    old: str
    new: str
    tests: str


BREAKS = (
    Break(
        "heartbeat slower tenfold",
        "rig/hardware/guard.py",
        "_BEATS_PER_TIMEOUT = 6",
        "_BEATS_PER_TIMEOUT = 0.6",
        SAFETY + "test_processes.py::test_a_long_quiet_hold_is_not_taken_for_silence",
    ),
    Break(
        "parent-death check off",
        "rig/hardware/guard_process.py",
        "dead = self._gone or os.getppid() != parent",
        "dead = False",
        SAFETY + "test_processes.py::test_a_dead_program_is_known_by_its_death_and_not_by_its_silence",
    ),
    Break(
        "retreat five times faster",
        "rig/hardware/retreat.py",
        "speed_v_s = lever.retreat_speed_mm_s *",
        "speed_v_s = 5 * lever.retreat_speed_mm_s *",
        "tests/rig/hardware/test_lever.py::test_retreat_is_slew_limited_and_recorded",
    ),
    Break(
        "safe-position check off",
        "rig/hardware/brake.py",
        "if abs(position_mm - safe_mm) > self._limits.following_error_max_mm:",
        "if False:",
        SAFETY + "test_motions.py::test_an_arm_that_does_not_come_to_safety_is_told",
    ),
    Break(
        "SIGTERM handler removed",
        "rig/engine/interrupts.py",
        "(signal.SIGINT, signal.SIGTERM,",
        "(signal.SIGINT,",
        SAFETY + "test_processes.py::test_a_run_that_is_told_to_end_clears_the_arm_first",
    ),
    Break(
        "overshoot not corrected",
        "rig/engine/motions.py",
        "start_mm + step.depth_mm - self.surface.overshoot_um / 1e3",
        "start_mm + step.depth_mm",
        SAFETY + "test_motions.py::test_the_overshoot_is_taken_off_the_depth",
    ),
    Break(
        "threshold of air collision x100",
        "rig/engine/positioning.py",
        "ContactDetector(threshold_mn, *_MET)",
        "ContactDetector(100 * threshold_mn, *_MET)",
        SAFETY + "test_motions.py::test_what_is_met_on_the_way_to_the_start_stops_the_arm",
    ),
    Break(
        "lock off",
        "rig/hardware/occupancy.py",
        "while not self._taken():",
        "while False:",
        SAFETY + "test_processes.py::test_a_second_run_in_the_rest_of_the_first_is_refused",
    ),
    Break(
        "force watch off",
        "rig/hardware/limits.py",
        '("force", force_mn, 0.0, allowed_mn, "mN"),',
        '("force", force_mn, 0.0, np.inf, "mN"),',
        "tests/rig/hardware/test_lever.py::test_a_force_limit_retracts_says_so_and_goes_on_recording",
    ),
    Break(
        "probe sign ignored",
        "rig/hardware/proof.py",
        "abs(moved_mm - sent_mm) <= _PROBE_TOLERANCE",
        "abs(abs(moved_mm) - abs(sent_mm)) <= _PROBE_TOLERANCE",
        SAFETY + "test_proof.py::test_a_position_that_runs_backwards_is_seen_by_the_probe",
    ),
    Break(
        "approach loaded whole",
        "rig/hardware/limits.py",
        "_LEAD_S = (0.02, 0.03)",
        "_LEAD_S = (20.0, 30.0)",
        SAFETY + "test_processes.py::test_a_host_that_stands_still_in_the_approach",
    ),
    Break(
        "dead force line not seen",
        "rig/hardware/limits.py",
        "if self.last_v < self._least_v:",
        "if False:",
        SAFETY + "test_motions.py::test_a_force_line_that_goes_dead_reverses_the_arm",
    ),
    Break(
        "lost gain of the force line not seen",
        "rig/hardware/limits.py",
        "_NOISE_KEPT * usual_noise_v",
        "0.0 * usual_noise_v",
        SAFETY + "test_motions.py::test_a_force_line_that_loses_most_of_its_gain_reverses_the_arm",
    ),
    Break(
        "the second guard told nothing by the program",
        "rig/hardware/guard.py",
        "if self._second_ear is None:",
        "if True:",
        SAFETY + "test_processes.py::test_after_two_failures_the_arm_is_clear_or_can_be_cleared",
    ),
    Break(
        "the sentinel says nothing",
        "rig/hardware/sentinel.py",
        'if word != b"away":',
        "if True:",
        SAFETY + "test_processes.py::test_after_two_failures_the_arm_is_clear_or_can_be_cleared",
    ),
    Break(
        "a stop left to the program's own thread",
        "rig/hardware/brake.py",
        "if self._flee_asked and self._drive.away:",
        "if False:",
        "tests/rig/hardware/test_fleeing.py::test_it_leaves_while_the_program_reads_nothing",
    ),
    Break(
        "guard's death not heeded",
        "rig/hardware/guard.py",
        "        if fault:\n            raise GuardError(",
        "        if False:\n            raise GuardError(",
        SAFETY + "test_processes.py::test_the_guard_is_heeded_while_the_program_reads_nothing",
    ),
)


def notices(broken: Break | None, tests: str) -> tuple[bool, str]:
    """Run tests in a copy of the project with a break (or none); whether one failed, and what they said."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "indenter"
        copy.mkdir()
        for name in _COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.h5"))
            else:
                shutil.copy2(source, copy / name)
        if broken is not None:
            path = copy / broken.file
            text = path.read_text(encoding="utf-8")
            if text.count(broken.old) != 1:
                raise SystemExit(
                    f"{broken.name}: {broken.file} holds {broken.old!r} {text.count(broken.old)} times"
                )
            path.write_text(text.replace(broken.old, broken.new), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests.split()],
            cwd=copy,
            env=os.environ | {"PYTHONPATH": str(copy)},
            capture_output=True,
            text=True,
            check=False,
        )
    # below 0: the guard ended the program that the test runs in; an error beside a test is no failure of it
    return " failed" in done.stdout or done.returncode < 0, done.stdout


def main(names: list[str]) -> int:
    """Make the breaks of these names (none: all), and say which were noticed."""
    chosen = [each for each in BREAKS if not names or each.name in names]
    unnoticed = 0
    for each in chosen:
        noticed, said = notices(each, each.tests)
        unnoticed += not noticed
        last = said.strip().splitlines()[-1] if said.strip() else "the program was ended"
        print(f"{'noticed' if noticed else 'NOT NOTICED'}: {each.name} ({last})", flush=True)
    print(f"{len(chosen) - unnoticed} of {len(chosen)} breaks noticed")
    return 1 if unnoticed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
