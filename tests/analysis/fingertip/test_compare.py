from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import calibrate, target_of
from analysis.fingertip.calibration_file import Calibration
from analysis.fingertip.compare import locate
from analysis.fingertip.contact import press, ramp_and_hold, touching_pressure
from analysis.fingertip.line_load import LineMotion, answer_lines, other_mesh
from analysis.fingertip.meshing import contact_sizes_mm, mesh_pad
from analysis.fingertip.page import write_comparison_page
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.reduced import chebyshev_ratios
from analysis.fingertip.surface_file import MeasuredSurface, read_surface
from analysis.fingertip.viscoelastic import relaxation

_PLACES_MM = np.concatenate([-np.arange(0.2, 3.01, 0.1)[::-1], np.arange(0.2, 3.01, 0.1)])
_NOISE_MM = 0.005
_OWN_MM = 0.45
"""Thickness of the epidermis: two thirds of it still hold a coarse mesh."""


def _answers_of(pad, measured, cache):
    target, punch = target_of(measured), punch_pad(pad, cache)
    pads = (
        calibrate(punch, target, "homogeneous", 1.0, 2),
        calibrate(punch, target, "layered", 0.1, 2),
    )
    found = Calibration(pad, measured, pads, ())
    few = chebyshev_ratios(0.02, 2.0, 2)
    return answer_lines(found, LineMotion(), cache, (0.03, 0.08, 0.3, 1.0), few)


@pytest.fixture(scope="module")
def answers(flat_pad, measured, cache):
    """Lines into pads of flat elements: seconds, and a mesh whose error is tens of micrometres."""
    return _answers_of(flat_pad.with_epidermis(_OWN_MM), measured, cache)


def test_a_reduced_punch_goes_where_the_full_march_goes(coarse_pad, punch, measured, full_march):
    """The march's error falls as the square of its step; without it both agree to 1e-6 of the peak."""
    materials = calibrate(punch, target_of(measured), "layered", 0.1, 2).materials(punch.relative)

    def both(step_s):
        time_s = step_s * np.arange(1, round(1 / step_s) + 1)
        depth_mm = 0.4 * np.minimum(time_s / 0.2, 1.0)
        marched = full_march.march_punch(coarse_pad, materials, depth_mm, step_s)
        exact = relaxation(punch.layers, materials).force_mn(np.append(0.0, depth_mm), step_s)[1:]
        return marched, exact

    coarse, exact = both(0.05)
    fine, _ = both(0.025)
    assert np.abs((4 * fine[1::2] - coarse) / 3 - exact).max() < 1e-6 * exact.max()


def test_no_patch_pulls_and_none_overlaps(answers):
    for pressed in answers.pressed:
        assert pressed.overlap_mm < 1e-9
        assert pressed.pull_kpa < 1e-9
        touching = (pressed.pressure_kpa > 0).sum(axis=1)
        assert touching[0] < touching[19]  # the ramp ends after 20 steps: contact has grown
        assert touching[-1] < pressed.pressure_kpa.shape[1]  # the ends of the line never touch


def test_contact_against_non_negative_least_squares():
    from scipy.optimize import nnls

    rng = np.random.default_rng(3)
    for _ in range(50):
        root = rng.standard_normal((12, 12))
        compliance = root @ root.T + 0.1 * np.eye(12)
        wanted = rng.standard_normal(12)
        factor = np.linalg.cholesky(compliance)
        other, _ = nnls(factor.T, np.linalg.solve(factor, wanted))
        found = touching_pressure(compliance, wanted, np.zeros(12, dtype=bool))
        np.testing.assert_allclose(found, other, atol=1e-8)


def test_a_stiffer_core_leaves_a_narrower_trough(answers):
    at = np.array([0.5, 1.0])
    deflection = answers.layered_at(at)
    by_ratio = np.array([deflection(np.log(r), _OWN_MM) for r in (0.04, 0.1, 0.5)])
    assert (np.diff(by_ratio, axis=0) < 0).all()
    assert (answers.homogeneous_at(at) < by_ratio[1]).all()


@pytest.mark.slow
def test_a_concealed_ratio_is_found_and_the_homogeneous_pad_fails(
    coarse_pad, measured, full_march, cache, tmp_path
):
    """The surface comes from the full march on another mesh; noise of 5 um a place, seed fixed.

    These meshes are coarse: they differ by more than the noise, which the interval knows.
    """
    answers = _answers_of(coarse_pad.with_epidermis(_OWN_MM), measured, cache)
    sizes = {"contact_size_mm": 0.04, "size_mm": 1.0}
    other = coarse_pad.with_epidermis(0.9 * _OWN_MM)
    other = other.model_copy(update={"mesh": coarse_pad.mesh.model_copy(update=sizes)})
    punch = punch_pad(other, tmp_path)
    materials = calibrate(punch, target_of(measured), "layered", 0.1, 2).materials(punch.relative)
    depth_mm = 0.5 * np.minimum(0.2 * np.arange(1, 21), 1.0)
    truth = full_march.march_line(other, materials, depth_mm, 0.2, _PLACES_MM)
    noise = _NOISE_MM * np.random.default_rng(5).standard_normal(len(truth))
    surface = MeasuredSurface("s", _PLACES_MM, truth + noise, np.full(len(truth), _NOISE_MM))
    found = locate(surface, answers)
    assert found.ratio == pytest.approx(0.1, rel=0.25)
    assert found.ratio_low < 0.1 < found.ratio_high
    assert found.ratio_high / found.ratio_low < 2.5
    assert np.sqrt(np.mean(found.mesh_mm**2)) > _NOISE_MM / 5
    homogeneous, _, best = found.pads
    assert homogeneous.fails
    assert homogeneous.spans
    assert best.rms_mm < homogeneous.rms_mm / 10
    # without errors in the file the verdict is the same
    blind = locate(replace(surface, error_mm=np.full(len(truth), np.nan)), answers)
    assert blind.pads[0].fails
    assert blind.error_mm[0] == pytest.approx(_NOISE_MM, rel=0.8)


def test_the_error_of_the_mesh_widens_the_interval(answers):
    """A surface of the pad itself: with no error of the mesh its ratio is known to the noise, else less well."""
    deflection = answers.layered_at(_PLACES_MM)(np.log(0.1), _OWN_MM)
    surface = MeasuredSurface("s", _PLACES_MM, deflection, np.full(len(deflection), _NOISE_MM))
    sure = locate(surface, replace(answers, mesh_error=np.zeros_like(answers.mesh_error)))
    honest = locate(surface, answers)
    twice = locate(surface, replace(answers, mesh_error=2 * answers.mesh_error))
    widths = [np.log(found.ratio_high / found.ratio_low) for found in (sure, honest, twice)]
    assert widths[0] < widths[1] < widths[2]
    for found in (sure, honest, twice):
        assert found.ratio_low < 0.1 < found.ratio_high


def test_a_second_mesh_is_another_where_the_first_is_off(coarse_pad):
    """Coarser under the line too, where most of the error is; locked elements of order 2 beside better ones."""
    cubic = coarse_pad.with_order(3)
    coarser, share = other_mesh(cubic)
    assert coarser.mesh.order == 3
    assert share == pytest.approx(2.0)
    for load in ("punch", "line", "plate"):
        sizes, larger = (np.array(contact_sizes_mm(pad.mesh, load)) for pad in (cubic, coarser))
        assert larger == pytest.approx(1.5 * sizes)
    fine = cubic.model_copy(
        update={"mesh": cubic.mesh.model_copy(update={"contact_size_mm": 0.001, "grading": 0.4})}
    )
    assert contact_sizes_mm(other_mesh(fine)[0].mesh, "line")[0] == pytest.approx(
        1.5 * fine.mesh.line_size_mm
    )
    assert other_mesh(fine)[0].mesh.grading == pytest.approx(0.6)
    better, share = other_mesh(coarse_pad)
    assert better == cubic
    assert share == pytest.approx(-9 / 5)


def test_the_page_says_what_fails_and_where(answers, tmp_path):
    deflection = answers.layered_at(_PLACES_MM)(np.log(0.1), _OWN_MM)
    noise = _NOISE_MM * np.random.default_rng(6).standard_normal(len(deflection))
    errors = np.full(len(deflection), _NOISE_MM)
    # with all of its error this mesh could refute nothing
    finer = replace(answers, mesh_error=0.1 * answers.mesh_error)
    found = locate(MeasuredSurface("surface.csv", _PLACES_MM, deflection + noise, errors), finer)
    assert found.ratio_low < 0.1 < found.ratio_high
    assert not found.pads[2].fails
    page = write_comparison_page(tmp_path, found, finer).read_text()
    assert 'homogeneous</td><td class="text">fails' in page
    assert json.loads((tmp_path / "compare.json").read_text())["pads"][0]["off_where"]
    assert {path.name for path in tmp_path.glob("*.vtu")} == {"homogeneous_line.vtu", "layered_line.vtu"}


def test_a_pads_curve_goes_on_where_nothing_was_measured(answers):
    """Places beside the line only: the trough between them is drawn as deep as the pad has it."""
    deflection = answers.layered_at(_PLACES_MM)(np.log(0.1), _OWN_MM)
    errors = np.full(len(deflection), _NOISE_MM)
    found = locate(MeasuredSurface("s", _PLACES_MM, deflection, errors), answers)
    assert (found.along_mm[0], found.along_mm[-1]) == (_PLACES_MM[0], _PLACES_MM[-1])
    for pad in found.pads:
        measured = np.isin(found.along_mm, _PLACES_MM)
        np.testing.assert_allclose(pad.curve_mm[measured], pad.deflection_mm, atol=1e-12)
    here = found.along_mm == 0.0
    plain, _, best = found.pads
    assert plain.curve_mm[here] == pytest.approx(answers.homogeneous_at(np.zeros(1)))
    assert best.curve_mm[here] == pytest.approx(
        answers.layered_at(np.zeros(1))(np.log(0.1), _OWN_MM), rel=1e-3
    )
    assert plain.curve_mm[here] > 1.2 * plain.deflection_mm.max()


def test_motion_ends_where_it_should():
    time_s, depth_mm = ramp_and_hold(0.5, 1.0, 3.0, 20, 16)
    assert (np.diff(time_s) > 0).all()
    assert (time_s[19], depth_mm[19], time_s[-1], depth_mm[-1]) == pytest.approx((1.0, 0.5, 4.0, 0.5))


def test_a_homogeneous_pad_relaxes_under_the_line_as_its_material(answers):
    """With one relaxation everywhere the shape stays while the line is held, and only the force relaxes."""
    pressed = answers.pressed[0]
    np.testing.assert_allclose(
        pressed.weights[19], pressed.weights[-1], atol=2e-3 * np.abs(pressed.weights[-1]).max()
    )
    assert pressed.force_mn[-1] < 0.8 * pressed.force_mn[19]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("position_mm,deflection_um\n1,2\n", "'deflection_um' is there: give millimetres"),
        ("position,deflection_mm\n1,2\n", "column 'position_mm' is missing"),
        (
            "position_mm,deflection_mm\n" + "".join(f"{i},{400 - 10 * i}\n" for i in range(9)),
            "reaches 400 .* give mm",
        ),
        (
            "position_mm,deflection_mm\n" + "".join(f"{i}00,0.1\n" for i in range(9)),
            "longer than a finger tip",
        ),
        (
            "position_mm,deflection_mm\n" + "".join(f"{i}e-3,0.1\n" for i in range(9)),
            "spans only 0.008: .* give mm",
        ),
        ("position_mm,deflection_mm\n1,x\n", "line 2: not a number"),
        ("position_mm,deflection_mm\n1,nan\n", "line 2: not a finite number"),
        ("position_mm,deflection_mm\n1,0.1\n", "1 places; at least 8"),
        ("position_mm,deflection_mm\n" + "".join(f"{i},-0.2\n" for i in range(9)), "counts into the pad"),
    ],
)
def test_a_wrong_surface_file(tmp_path, text, said):
    path = tmp_path / "surface.csv"
    path.write_text(text)
    with pytest.raises(BadInputError, match=said):
        read_surface(path, 0.5)


def test_a_line_wider_than_the_pad_is_told(coarse_pad):
    width = coarse_pad.geometry.half_width_mm.model_copy(update={"value": 2.4})
    narrow = coarse_pad.model_copy(
        update={"geometry": coarse_pad.geometry.model_copy(update={"half_width_mm": width})}
    )
    with pytest.raises(BadInputError, match=r"half_width_mm = 2\.4: the line of 5 mm is as wide as the pad"):
        mesh_pad(narrow, "line")


def test_pressing_nothing_gives_nothing(answers):
    pad = answers.model
    none = press(
        pad, answers.pads[1][0].materials(pad.relative), np.array([0.1, 0.2]), np.array([-0.1, -0.1])
    )
    assert not none.force_mn.any()
    assert not none.weights.any()
