"""What a fit needs, loaded before the first trial is there to be fitted."""

from __future__ import annotations

import numpy as np

from analysis.recordings.trial import Calibration, Phase, ProtocolSummary, Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.prediction import fitted_curve
from analysis.relaxation.response import force_response

_RATE_HZ = 1000.0


def warm_up() -> float:
    """Fit a made-up trial by both models and return its A0, mN: all that a fit imports is loaded then."""
    times_s = (0.0, 0.2, 0.5, 1.0, 1.08, 5.0)
    places_mm = (0.7, 0.7, 1.0, 1.0, 1.4, 1.4)
    time_s = np.arange(0.0, times_s[-1], 1.0 / _RATE_HZ)
    position_mm = np.interp(time_s, times_s, places_mm)
    depth_mm = np.maximum(position_mm - 0.95, 0.0)
    force_mn = force_response(depth_mm, 1.0 / _RATE_HZ, 120.0, [(44.5, 1.0), (35.3, 0.1)])
    noise_mn = np.random.default_rng(0).normal(scale=0.3, size=len(time_s))
    trial = Trial(
        trial_id="warm-up",
        started="",
        kind="ramp_hold_retract",
        source="simulated",
        status="complete",
        sample_rate_hz=_RATE_HZ,
        position_v=position_mm,
        force_v=force_mn + noise_mn,
        command_v=None,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        phases=(
            Phase("approach", 0, 500),
            Phase("dwell", 500, 1000),
            Phase("ramp", 1000, 1080),
            Phase("hold", 1080, len(time_s)),
        ),
        protocol=ProtocolSummary(depth_mm=0.4),
    )
    row = fit_trial(trial)
    fitted_curve(trial, row)
    fit_trial(trial, "step")
    return row.estimates["A0_mn"].value
