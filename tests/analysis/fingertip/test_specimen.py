from __future__ import annotations

import tomllib

import numpy as np
import pytest

from analysis.fingertip.calibrate import calibrate, target_of
from analysis.fingertip.specimen import write_specimen
from analysis.relaxation.fit import fit_trial
from sim_hardware.concealment.offline import TrialPlan
from sim_hardware.settings import BenchSettings


def _bench(path) -> BenchSettings:
    import tomlkit

    settings = tomllib.loads(path.read_text())["companion"]["settings"]
    settings |= {"constants": {"spread": 0.0, "zero_spread_v": 0.0}}
    return BenchSettings.from_toml(tomlkit.dumps(settings))


@pytest.mark.parametrize("kind", ["homogeneous", "layered"])
def test_a_calibrated_pad_is_recorded_and_fitted_as_any_finger(punch, measured, tmp_path, bench_trials, kind):
    """The bench's force is the pad's, and the fit of its recording is what the pad was calibrated on."""
    pad = calibrate(punch, target_of(measured), kind, 0.1, 2)
    write_specimen(tmp_path / "rig.toml", pad, 0.5)
    (trial,) = bench_trials(
        _bench(tmp_path / "rig.toml"), [TrialPlan(depth_mm=0.4, repeat=1, finger="index")]
    )
    found = fit_trial(trial, "ramp")
    assert found.solid is not None
    # the layered pad's force is a sum of more than two exponentials, within 0.02 % of A0 of the measured two
    assert found.solid.stiffness_mn_per_mm == pytest.approx(measured.stiffness_mn_per_mm, rel=0.01)
    assert found.solid.times_s == pytest.approx(measured.times_s, rel=0.02)


def test_a_bench_takes_arms_or_the_published_two():
    arms = "arms = [{ stiffness_mn_per_mm = 3.0, time_s = 1.0 }]"
    settings = BenchSettings.from_toml(f"[tissue]\n{arms}")
    assert settings.tissue.arms[0].time_s == 1.0
    with pytest.raises(ValueError, match="one or the other"):
        BenchSettings.from_toml(f"[tissue]\nk1_mn_per_mm = 2.0\n{arms}")
    with pytest.raises(ValueError, match="mN/mm"):
        BenchSettings.from_toml("[tissue]\narms = [{ stiffness_mn_per_mm = -3.0, time_s = 1.0 }]")


def test_the_rig_takes_the_file(punch, measured, tmp_path):
    from rig.settings.reading import load_rig

    pad = calibrate(punch, target_of(measured), "layered", 0.1, 2)
    write_specimen(tmp_path / "rig.toml", pad, 0.5)
    assert load_rig(tmp_path / "rig.toml").punch.diameter_mm == 0.5
    assert np.isfinite(pad.rms_share)
