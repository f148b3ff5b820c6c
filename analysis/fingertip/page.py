"""The pages of the finger pad: each one HTML file that holds its tables and figures and can be mailed."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from analysis.fingertip.calibrate import CalibratedPad, Target, calibrate, published_trial, target_of
from analysis.fingertip.calibration_file import Calibration
from analysis.fingertip.compare import Located
from analysis.fingertip.comparison_file import write_comparison
from analysis.fingertip.figures import draw_calibration, draw_comparison
from analysis.fingertip.fits_file import MeasuredTrial
from analysis.fingertip.line_load import LineAnswers
from analysis.fingertip.meshing import LINE_LENGTH_MM
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.reduced import PunchPad
from analysis.fingertip.view import write_vtu
from analysis.relaxation.published import SOURCE

_NO_ERROR, _ROUNDING = 1e-6, 1e-9
_KINDS = {"homogeneous": "homogeneous", "layered": "elastic epidermis, viscoelastic core"}
_CAPTIONS = {
    "force": "Measured relaxation (the mean of the trials) and the calibrated pads, with what they are off by below.",
    "scan": "Left: residual of the best pad at every ratio of core to epidermis; broken line: 0.1 % of A0. "
    "Right: the moduli that go with it.",
    "sections": "Section in the plane of symmetry after the hold, true to scale: epidermis, dermis and fat from "
    "outside; the bone is rigid and left out.",
}
_COMPARE_CAPTIONS = {
    "surface": "Measured deflection with its errors, and each pad pressed as the finger was; below, measured minus pad "
    "with twice the error in grey.",
    "profile": "How much worse the best pad of a ratio fits than the best of all; broken line: where the 95 % interval "
    "(grey) ends.",
    "line_section": "Section in the plane of symmetry under the line, true to scale: epidermis, dermis and fat.",
}


def write_calibration_page(
    out: Path, found: Calibration, target: Target, punch: PunchPad, trials: Sequence[MeasuredTrial]
) -> Path:
    """Draw the figures, write VTU files and ``calibration.html`` into ``out``; return the page's path."""
    figures = draw_calibration(out, found, target, punch)
    for pad in found.pads:
        moduli = np.array([m.relaxed_kpa for m in pad.materials(punch.relative)])
        moved = punch.view.displaced(found.measured.depth_mm * punch.answer(moduli))
        write_vtu(out / f"{pad.kind}_pressed.vtu", punch.view, {"displacement_mm": moved})
    published = [
        calibrate(punch, target_of(published_trial()), pad.kind, pad.ratio, len(pad.core.arms))
        for pad in found.pads
    ]
    return render(
        out / "calibration.html",
        "calibration.html.j2",
        figures,
        _CAPTIONS,
        n=len(trials),
        measured=found.measured,
        source=SOURCE,
        pads=[_cells(pad) for pad in found.pads],
        published=[_cells(pad) for pad in published],
        scan=[_cells(pad) for pad in found.scan],
        worst=100 * max(pad.rms_share for pad in found.scan),
        sizes=_sizes(found.pad),
        unknowns=punch.unknowns,
        slides=found.pad.punch.contact == "frictionless",
        pulled=punch.pull_share,
        reduced_off=max(
            abs(punch.stiffness(punch.layer_moduli(r)) / f - 1)
            for r, f in zip(punch.ratios.tolist(), punch.exact.tolist(), strict=True)
        ),
    )


def write_comparison_page(out: Path, found: Located, answers: LineAnswers) -> Path:
    """Draw the figures, write the VTU files, ``compare.json`` and ``compare.html``; return the page's path."""
    figures = draw_comparison(out, found, answers)
    nearest = int(np.argmin(np.abs(np.log(answers.ratios) - np.log(found.ratio))))
    for name, pressed in (("homogeneous", answers.pressed[0]), ("layered", answers.pressed[1 + nearest])):
        moved = answers.model.view.displaced(pressed.weights[-1])
        write_vtu(out / f"{name}_line.vtu", answers.model.view, {"displacement_mm": moved})
    write_comparison(out / "compare.json", found, answers.motion)
    half_length_mm = [
        float(np.abs(answers.model.place_mm[pressed.pressure_kpa[-1] > 0, 0]).max())
        for pressed in answers.pressed
    ]
    return render(
        out / "compare.html",
        "compare.html.j2",
        figures,
        _COMPARE_CAPTIONS,
        found=found,
        motion=answers.motion,
        touching=(min(half_length_mm), max(half_length_mm)),
        line_half_mm=LINE_LENGTH_MM / 2,
        thickness_ends=answers.thickness_mm[[0, -1]].tolist(),
        ratio_ends=answers.ratios[[0, -1]].tolist(),
        overlap=max(pressed.overlap_mm for pressed in answers.pressed),
        pull=max(pressed.pull_kpa for pressed in answers.pressed),
        unknowns=answers.model.unknowns,
        mesh_um=1e3 * float(np.sqrt(np.mean(found.mesh_mm**2))),
    )


def render(
    path: Path, template: str, figures: Mapping[str, Path], captions: Mapping[str, str], **values: Any
) -> Path:
    """Write a page from a template of this package with its figures inside; return its path."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("analysis.fingertip", "."), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template(template).render(
        date=datetime.now().astimezone().strftime("%Y-%m-%d"),
        version=version("indenter"),
        figures=[
            {"data": base64.b64encode(png.read_bytes()).decode(), "caption": captions[name]}
            for name, png in figures.items()
        ],
        **values,
    )
    path.write_text(html, encoding="utf-8")
    return path


def _cells(pad: CalibratedPad) -> dict[str, Any]:
    arms = len(pad.core.arms)
    errors = pad.errors()
    return {
        "kind": _KINDS[pad.kind],
        "ratio": f"{pad.ratio:.3g}",
        "epidermis": _with_error(pad.epidermis.relaxed_kpa, errors[0]),
        "core": _with_error(pad.core.relaxed_kpa, errors[0]),
        "at_once": f"{pad.core.instantaneous_kpa:.4g}",
        "g": [f"{g:.4f}" for g in pad.core.g],
        "times": [_with_error(t, e) for (_, t), e in zip(pad.core.arms, errors[1 + arms :], strict=True)],
        "moduli": [_with_error(m, e) for (m, _), e in zip(pad.core.arms, errors[1 : 1 + arms], strict=True)],
        "rms": _per_cent(pad.rms_share),
        "worst": _per_cent(pad.worst_share),
    }


def _per_cent(share: float) -> str:
    return f"{100 * share:.2g}" if share >= _ROUNDING else "rounding"


def _with_error(value: float, log_error: float) -> str:
    """Return a value with the standard error of its logarithm, both to the error's second digit."""
    error = value * float(log_error)
    # an error below the digits that are shown is that of a value given without one
    if not _NO_ERROR * value < error < np.inf:
        return f"{value:.5g}"
    decimals = min(max(1 - int(np.floor(np.log10(error))), 0), 9)
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def _sizes(pad: PadFile) -> list[dict[str, str]]:
    if pad.mesh.file is not None:
        return [{"name": "mesh", "value": pad.mesh.file.name, "source": "the user's own"}]
    sizes = ((name, getattr(pad.geometry, name)) for name in type(pad.geometry).model_fields)
    return [{"name": name, "value": f"{size.value:g}", "source": size.source} for name, size in sizes]
