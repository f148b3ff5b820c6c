"""The library: names and parameters as fixed, each law absent at its null and present at its probes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Tissue, Tissues, library
from analysis.simulation.motion import estimate_motion
from analysis.simulation.reduction import reduce_trial

SHARED = Path(__file__).parents[4] / "shared" / "mechanisms.md"
LENGTHS = (
    "position_mm", "velocity_mm_s", "acceleration_mm_s2", "command_mm", "z0_start_mm", "depth_mm", "study_depth_mm",
)  # fmt: skip
TISSUE = Tissue(120.0, 44.5, 2.279, 35.3, 0.149)


@pytest.fixture(scope="module")
def trial() -> CellTrial:
    import sys

    sys.path.append(str(Path(__file__).parents[2]))
    from bench_trials import bench_trials

    from sim_hardware.concealment.offline import study_plans

    plans = study_plans(depths_mm=(0.4,), repeats=2)
    recorded = bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)[1]
    return reduce_trial(
        recorded, estimate_motion(recorded), order=1, pressed_before=(0.4, recorded.specimen.rest_s or 0.0)
    )


def test_names_and_parameters_are_those_of_the_physics_library() -> None:
    if not SHARED.exists():
        pytest.skip("the physics library's text is not beside the project")
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \|.*\| ([^|]*) \|$", SHARED.read_text(), re.MULTILINE)
    assert {name for name, _, _ in rows} == set(library())
    for name, stage, parameters in rows:
        mechanism = library()[name]
        assert mechanism.stage == stage, name
        outer = [p.name for p in mechanism.parameters if not p.inner]
        assert outer == re.findall(r"`(\w+)`", parameters), name


@pytest.mark.parametrize(
    "mechanism", [m for m in library().values() if m.form == "law"], ids=lambda m: m.name
)
def test_law_is_absent_at_its_null_and_seen_at_its_probes(mechanism: Mechanism, trial: CellTrial) -> None:
    own = PerTrial(trial.z0_start_mm, trial.offset_start_mn)
    plain = simulate_force(trial, TISSUE, own)
    null = simulate_force(trial, TISSUE, own, [(mechanism, mechanism.null)])
    size = float(np.ptp(plain))
    # an arc of 10 m is as straight as a parameter with an upper bound can say
    np.testing.assert_allclose(null, plain, atol=(1e-4 if mechanism.name == "lever_arc" else 1e-9) * size)
    seen = []
    for values in mechanism.probe_settings(size, trial.depth_mm):
        changed = simulate_force(trial, TISSUE, own, [(mechanism, {**mechanism.null, **values})])
        assert np.all(np.isfinite(changed))
        seen.append(float(np.max(np.abs(changed - plain))))
    # what the previous indentation left may be gone after the rest, for the shorter of its times
    assert (max(seen) if mechanism.name == "incomplete_recovery" else min(seen)) > 1e-5 * size


@pytest.mark.parametrize(
    "mechanism", [m for m in library().values() if m.form == "law"], ids=lambda m: m.name
)
def test_rows_are_simulated_as_one_by_one(mechanism: Mechanism, trial: CellTrial) -> None:
    own = PerTrial(trial.z0_start_mm, trial.offset_start_mn)
    surface_mm = 0.01 * np.sin(np.multiply.outer([1.0, 3.0, 8.0], trial.time_s))
    lost = 0.1 * np.abs(surface_mm[::-1])
    size = float(np.ptp(simulate_force(trial, TISSUE, own)))
    for values in mechanism.probe_settings(size, trial.depth_mm):
        added = [(mechanism, {**mechanism.null, **mechanism.typical, **values})]
        rows = simulate_force(trial, TISSUE, own, added, surface_mm=surface_mm, lost_share=lost)
        for row, surface, share in zip(rows, surface_mm, lost, strict=True):
            alone = simulate_force(trial, TISSUE, own, added, surface_mm=surface, lost_share=share)
            np.testing.assert_allclose(row, alone, rtol=1e-12, atol=1e-12 * size)
    for alone in ({"surface_mm": surface_mm}, {"lost_share": lost}):
        assert simulate_force(trial, TISSUE, own, added, **alone).shape == surface_mm.shape


@pytest.mark.parametrize(
    "mechanism", [m for m in library().values() if m.form == "law"], ids=lambda m: m.name
)
def test_tissues_are_simulated_as_one_by_one(mechanism: Mechanism, trial: CellTrial) -> None:
    own = PerTrial(trial.z0_start_mm, trial.offset_start_mn)
    logarithms = TISSUE.logarithms + 0.2 * np.random.default_rng(5).standard_normal((3, 5))
    size = float(np.ptp(simulate_force(trial, TISSUE, own)))
    for values in mechanism.probe_settings(size, trial.depth_mm):
        added = [(mechanism, {**mechanism.null, **mechanism.typical, **values})]
        rows = simulate_force(trial, Tissues.at(logarithms), own, added)
        assert np.ptp(rows, axis=0).max() > 0.01 * size
        for row, of_it in zip(rows, logarithms, strict=True):
            alone = simulate_force(trial, Tissue(*np.exp(of_it)), own, added)
            np.testing.assert_allclose(row, alone, rtol=1e-12, atol=1e-12 * size)


@pytest.mark.parametrize("offset_mn", [-7.0, 4.0])
def test_a_channel_s_range_is_that_of_its_reading(offset_mn: float, trial: CellTrial) -> None:
    """With an offset the level is reached by another force, and nothing but the offset is different below it."""
    saturation, own = library()["force_saturation"], PerTrial(trial.z0_start_mm, 0.0)
    level_mn = 0.8 * float(np.ptp(simulate_force(trial, TISSUE, own)))

    def read_mn(offset_mn: float) -> np.ndarray:
        values = {"level_mn": level_mn, "slope_above": 0.0, "knee": 1e-3}
        return simulate_force(trial, TISSUE, replace(own, offset_mn=offset_mn), [(saturation, values)])

    plain_mn, there_mn = simulate_force(trial, TISSUE, own), read_mn(offset_mn)
    above = plain_mn + offset_mn > 1.02 * level_mn
    below = plain_mn + offset_mn < 0.98 * level_mn
    assert above.any() and below.any()
    np.testing.assert_allclose(there_mn[above], level_mn, rtol=1e-6)
    np.testing.assert_allclose(there_mn[below], plain_mn[below] + offset_mn, rtol=0, atol=1e-6 * level_mn)


@pytest.mark.parametrize("name", ["adhesion", "coulomb_friction", "force_saturation", "stiffening"])
def test_units_of_length_and_force_change_nothing(name: str, trial: CellTrial) -> None:
    """Written in other units every quantity of a recording is another number, and the fit of a law the same."""
    mechanism, by = library()[name], 1e-3
    small = replace(
        trial,
        **{f: by * getattr(trial, f) for f in LENGTHS},  # type: ignore[arg-type]
    )
    size = float(np.ptp(simulate_force(trial, TISSUE, PerTrial(trial.z0_start_mm, 0.0))))
    own, own_small = PerTrial(trial.z0_start_mm, 0.0), PerTrial(by * trial.z0_start_mm, 0.0)
    # the same forces by the same stiffness of a thousandth of the depth
    stiff = Tissue(TISSUE.k0 / by, TISSUE.k1 / by, TISSUE.tau1, TISSUE.k2 / by, TISSUE.tau2)
    probes = mechanism.probe_settings(size, trial.study_depth_mm)
    probes_small = mechanism.probe_settings(size, small.study_depth_mm)
    for values, there in zip(probes, probes_small, strict=True):
        here = simulate_force(trial, TISSUE, own, [(mechanism, {**mechanism.null, **values})])
        other = simulate_force(small, stiff, own_small, [(mechanism, {**mechanism.null, **there})])
        np.testing.assert_allclose(other, here, atol=2e-3 * size)


def test_every_mechanism_says_in_words_what_it_is() -> None:
    for mechanism in library().values():
        assert len(mechanism.words) > 20, mechanism.name
        assert mechanism.source, mechanism.name
        if mechanism.parameters:
            assert mechanism.amplitude in {p.name for p in mechanism.parameters}
        # a site's own value is so many times the others': none may be nothing or less
        assert all(mechanism.parameter(name).lower >= 0.0 for name in mechanism.of_site), mechanism.name
        for other in mechanism.inseparable:
            assert other in library()


def test_compliance_before_a_rigid_block_is_two_springs_in_series() -> None:
    n = 400
    x = np.linspace(-0.001, 0.01, n)
    zeros = np.zeros(n)
    block = CellTrial(
        label="block", kind="rigid_target", condition="", order=0, sample_rate_hz=8000.0,
        starts=np.arange(n), counts=np.ones(n), full_force_mn=zeros.astype(np.float32),
        full_servo_residual_mm=zeros.astype(np.float32), time_s=np.arange(n) / 8000.0, position_mm=x,
        velocity_mm_s=np.gradient(x) * 8000.0, acceleration_mm_s2=zeros, shake_mm_s2=np.zeros((n, 2)),
        command_mm=x, force_mn=zeros, servo_residual_mm=zeros,
        servo_signature_mm=np.zeros((n, 2)), phase=np.full(n, 2), z0_start_mm=0.0,
        offset_start_mn=0.0, depth_mm=0.01, has_command=True,
    )  # fmt: skip
    compliance = library()["lever_compliance"]
    force = simulate_force(
        block, TISSUE, PerTrial(0.0, 0.0), [(compliance, {"compliance_um_per_mn": 0.5})], rigid_stiffness=2e4
    )
    slope = np.polyfit(x[-50:], force[-50:], 1)[0]
    assert slope == pytest.approx(1.0 / (1.0 / 2e4 + 0.5e-3), rel=1e-3)
    # a block is as stiff as its trial states, where nothing else is asked for
    stated = simulate_force(replace(block, target_stiffness_mn_per_mm=3e4), TISSUE, PerTrial(0.0, 0.0))
    assert np.polyfit(x[-50:], stated[-50:], 1)[0] == pytest.approx(3e4, rel=1e-3)


def test_a_dashpot_in_series_with_a_spring_is_a_quick_arm(trial: CellTrial) -> None:
    own = PerTrial(trial.z0_start_mm, trial.offset_start_mn)
    c, settle_s = 0.4, 2e-3
    laws = [
        ("parallel_dashpot", {"coefficient_mn_s_per_mm": c, "settle_ms": 1e3 * settle_s}),
        ("third_relaxation", {"ratio_to_k0": c / settle_s / TISSUE.k0, "time_constant_s": settle_s}),
    ]
    dashpot, arm = (simulate_force(trial, TISSUE, own, [(library()[name], values)]) for name, values in laws)
    plain = simulate_force(trial, TISSUE, own)
    assert np.linalg.norm(dashpot - arm) < 0.02 * np.linalg.norm(arm - plain)


@pytest.mark.parametrize("with_depth", [0.2, 0.5, 1.0])
def test_a_dashpot_that_is_wetted_more_with_depth_has_its_mean_over_the_depths(
    trial: CellTrial, with_depth: float
) -> None:
    law, rising = library()["parallel_dashpot"], trial.in_phase("ramp")
    depth_mm = np.where(rising, np.cumsum(trial.velocity_mm_s * trial.widths_s * rising), 0.0)
    whole = replace(trial, study_depth_mm=float(depth_mm.max()))
    values = {"coefficient_mn_s_per_mm": 0.4, "settle_ms": 0.01, "with_depth": with_depth}
    force_mn = np.asarray(law.tissue_force_mn(whole, depth_mm, TISSUE, values))
    mean_mn = np.trapezoid(force_mn[rising] / trial.velocity_mm_s[rising], depth_mm[rising]) / depth_mm.max()
    assert mean_mn == pytest.approx(0.4, rel=0.03)
    assert np.all(np.diff(force_mn[rising][5:-5]) > 0.0)


def test_a_power_law_begins(trial: CellTrial) -> None:
    """Long after that it is the textbook's; a solid that holds to it at once is stiffer at first."""
    law, since_s = library()["power_law_relaxation"], np.array([1e-3, 0.03, 3.0])
    pressed = replace(trial, time_s=np.append(0.0, since_s), starts=trial.starts[:4], counts=trial.counts[:4])
    step_mm = np.array([0.0, 1.0, 1.0, 1.0])

    def relaxed(**form: float) -> np.ndarray:
        values = {"coefficient_mn_per_mm": 10.0, "exponent": 0.3, **form}
        return np.asarray(law.tissue_force_mn(pressed, step_mm, TISSUE, values))[1:]

    whole, late = relaxed(), relaxed(begins_s=0.02)
    np.testing.assert_allclose(relaxed(begins_s=1e-5), whole, rtol=0.02)
    assert late[0] < 0.75 * whole[0]
    assert late[-1] == pytest.approx(whole[-1], rel=0.02)
