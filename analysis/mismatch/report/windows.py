"""Where recordings differ, as the report's windows: of the force, and of the lever's position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.levels import LEVEL, SERVO_EXPLAINS, SERVO_KNOWN, TWO_ERRORS
from analysis.mismatch.locate.located import Located
from analysis.mismatch.locate.windows import PLACES
from analysis.mismatch.report.contents import Window
from analysis.simulation.servo import DEFAULT_DAMPING_RATIO, DEFAULT_NATURAL_FREQUENCY_RAD_S

MOST_WINDOWS = 10


def servo_named(diagnosis: Diagnosis) -> bool:
    """Whether another servo is seen in the position channel, and explains most of what differs there.

    A servo whose frequency stays unknown explains nothing: the drive is no such servo. One that lags by up to half a
    sample beyond the rig file's, within two errors, can't be told from an output that steps once a sample; none makes
    it lag less. Its lag is known far better than its frequency: to microseconds, as which converters are at one. Where
    the position is off by more than half a micrometre there is more than that to tell. Nor is it one if a delay of some
    samples explains as much.
    """
    position = diagnosis.position
    wn, zeta = diagnosis.intake.servo.of_lines
    rate_hz = min(t.sample_rate_hz for t in diagnosis.intake.trials)
    lag_s = 2.0 * zeta / wn
    later_s = lag_s - 2.0 * DEFAULT_DAMPING_RATIO / DEFAULT_NATURAL_FREQUENCY_RAD_S
    if position is None:
        return False
    error_s = lag_s * (position.lag_error if len(position.unknown_bins) else position.standard_errors[0])
    return (
        not position.late_s
        and position.p_value <= LEVEL
        and position.explained >= SERVO_EXPLAINS
        and position.standard_errors[0] < SERVO_KNOWN
        and max(-later_s, later_s - 0.5 / rate_hz) > TWO_ERRORS * error_s
    )


def force_windows(located: Sequence[Located], *, after_naming: bool = False) -> tuple[Window, ...]:
    """Return stretches of the force as the report's windows."""
    return tuple(
        Window(
            signal="force",
            phase=w.phase,
            start_s=w.start_s,
            stop_s=w.stop_s,
            mean_residual_mn=w.mean_mn,
            p_value=w.p_value,
            share_of_mismatch=w.share,
            conditions=w.words,
            rms_mn=w.rms_mn,
            after_naming=after_naming,
        )
        for w in located[:MOST_WINDOWS]
    )


def position_windows(diagnosis: Diagnosis) -> tuple[Window, ...]:
    """Return where the recorded position differs from its command's servo."""
    position = diagnosis.position
    if position is None:
        return ()
    bins = list(position.unknown_bins)
    if servo_named(diagnosis) and not bins:
        bins = np.flatnonzero(position.bin_p <= LEVEL).tolist() or [
            int(np.argmax(np.abs(position.profile_mm)))
        ]
    found = []
    for b in bins:
        spans = [s for t in diagnosis.intake.trials if (s := PLACES[b].span(t)) is not None]
        if spans:
            found.append(
                Window(
                    signal="position",
                    phase=PLACES[b].phase,
                    start_s=max(float(np.median([s[0] for s in spans])), 0.0),
                    stop_s=float(np.median([s[1] for s in spans])),
                    mean_residual_mn=None,
                    p_value=float(position.bin_p[b]),
                    share_of_mismatch=float(
                        position.profile_mm[b] ** 2 / max(float((position.profile_mm**2).sum()), 1e-30)
                    ),
                    conditions="every trial",
                    mean_residual_um=1e3 * float(position.profile_mm[b]),
                )
            )
    return tuple(sorted(found, key=lambda w: -w.share_of_mismatch))[:MOST_WINDOWS]
