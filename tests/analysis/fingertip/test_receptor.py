from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import calibrate, target_of
from analysis.fingertip.receptor import PlateMotion, drop, feel, plate_pad, read_rates, write_energies

MOTION = PlateMotion()


@pytest.fixture(scope="module", params=["homogeneous", "layered"])
def felt(request, coarse_pad, measured, punch, cache):
    calibrated = calibrate(punch, target_of(measured), request.param, 0.1, 2)
    return feel(coarse_pad, plate_pad(coarse_pad, calibrated, cache), calibrated, MOTION)


def test_contact_grows_and_neither_pulls_nor_overlaps(felt):
    touching_mm2 = (felt.pressed.pressure_kpa > 0) @ felt.model.area_mm2
    assert touching_mm2[0] < touching_mm2[10] < touching_mm2[19]
    assert touching_mm2[-1] < felt.model.area_mm2.sum()
    assert felt.pressed.overlap_mm < 1e-9
    assert felt.pressed.pull_kpa < 1e-9


def test_no_more_is_stored_than_half_of_stress_times_strain(felt):
    """While the plate is held an arm's stretch is less than the strain, so its stress counts against too much."""
    held = felt.time_s >= MOTION.ramp_s
    assert (felt.stored[:, held] <= felt.half_stress_strain[:, held] * (1 + 1e-9)).all()
    assert (felt.stored >= 0).all()


def test_an_elastic_epidermis_stores_what_it_is_given(felt, coarse_pad):
    epidermis = felt.depth_mm < coarse_pad.geometry.epidermis_mm.value
    same = np.allclose(felt.stored[epidermis], felt.half_stress_strain[epidermis], rtol=1e-9)
    assert same == (felt.pad.kind == "layered")


def test_energy_relaxes_as_force_where_all_relaxes_alike(felt):
    """Strain hardly moves while a homogeneous pad is held: stress times strain goes as the force."""
    ratios = drop(felt.half_stress_strain, felt.time_s, MOTION)
    force = float(drop(felt.force_mn, felt.time_s, MOTION))
    if felt.pad.kind == "homogeneous":
        assert ratios == pytest.approx(force, rel=0.02)
        assert force == pytest.approx(
            float(drop(felt.pad.force.after_ramp(felt.time_s, MOTION.ramp_s), felt.time_s, MOTION)), rel=0.02
        )
    else:
        core = felt.depth_mm > 0.35
        assert (ratios[core] > force).all()


def test_work_done_is_stored_or_lost(felt):
    """The elastic part of a slow press: force times motion is the energy of all shapes, to the steps' error."""
    pressed, model = felt.pressed, felt.model
    materials = felt.pad.materials(model.relative)
    work = np.trapezoid(np.append(0.0, pressed.force_mn), np.append(0.0, pressed.tool_mm))
    stored = 0.0
    number = 0
    for layer, material in zip(model.layers, materials, strict=True):
        stored += material.relaxed_kpa * pressed.weights[19] @ layer @ pressed.weights[19] / 2
        for modulus, _ in material.arms:
            stretch = pressed.stretches[19, number]
            stored += modulus * stretch @ layer @ stretch / 2
            number += 1
    assert 0.8 * work < stored < work


def test_no_depth_is_in_two_layers(felt, coarse_pad):
    """A ball across a border has the strain of both, and one modulus: the drop jumped there."""
    epidermis_mm = coarse_pad.geometry.epidermis_mm.value
    assert np.abs(felt.depth_mm - epidermis_mm).min() > 0.03
    ratios = drop(felt.stored, felt.time_s, MOTION)[felt.depth_mm > epidermis_mm]
    assert np.abs(np.diff(ratios)).max() < 0.05


def test_the_table_and_the_rates(felt, tmp_path):
    write_energies(tmp_path / "receptor.csv", [felt])
    lines = (tmp_path / "receptor.csv").read_text().splitlines()
    assert len(lines) == 1 + len(felt.depth_mm) * len(felt.time_s)
    (tmp_path / "rates.csv").write_text("time_s,rate_hz\n0.2,40\n0.1,90\n")
    assert read_rates(tmp_path / "rates.csv").rate_hz.tolist() == [90, 40]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_ms,rate_hz\n1,2\n", "'time_s' is missing"),
        ("time_s,rate_hz\n1,-2\n", "line 2: a rate"),
        ("time_s,rate_hz\n1,x\n", "line 2: not a number"),
        ("time_s,rate_hz\n1,2\n", "fewer than 2 rows"),
        ("time_s,rate_hz\n1,2\n2300,4\n", "give seconds"),
    ],
)
def test_wrong_rates(tmp_path, text, said):
    (tmp_path / "rates.csv").write_text(text)
    with pytest.raises(BadInputError, match=said):
        read_rates(tmp_path / "rates.csv")
