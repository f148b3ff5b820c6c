"""The pad under the flat punch, from the full mesh to some ten shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.fingertip.cache import key_of, recall
from analysis.fingertip.elastic import ElasticPad, nus_of
from analysis.fingertip.meshing import FIXED, PUNCH, mesh_pad
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.progress import shown_progress
from analysis.fingertip.reduced import PunchPad, chebyshev_ratios, energy_basis
from analysis.fingertip.view import MeshView, view_of
from analysis.recordings.trial import FloatArray

RATIOS = (0.004, 4.0)
"""Of core to epidermis, from a relaxed core 0.01 of the epidermis that has relaxed by 60 % to the stiffest
instant of one as stiff as it."""
SNAPSHOTS = 9
"""Nine answer for any ratio between to 4e-8 of the force, each one more to a ninth of that."""
_ROUNDING = 1e-13


def full_punch_pad(pad: PadFile) -> ElasticPad:
    """Return the full mesh under the punch: it sticks to the skin, or holds it along y only."""
    mesh = mesh_pad(pad, "punch")
    if pad.punch.contact == "bonded":
        return ElasticPad(mesh, nus_of(pad), held=f"{FIXED}|{PUNCH}")
    return ElasticPad(mesh, nus_of(pad), held_along_y=PUNCH)


def punch_pad(pad: PadFile, cache: Path) -> PunchPad:
    """Return the pad under the punch, solved now or found in the cache."""
    key = key_of(pad, "punch", {"ratios": RATIOS, "snapshots": SNAPSHOTS})

    def solve() -> Mapping[str, Any]:
        with shown_progress("solving the pad under the punch", 1 + SNAPSHOTS) as advance:
            return _arrays(reduce_punch(pad, advance))

    stored = recall(cache, key, solve)
    view = MeshView(**{name: stored[f"view_{name}"] for name in MeshView.__dataclass_fields__})
    return PunchPad(
        stored["layers"],
        stored["ratios"],
        stored["exact"],
        stored["relative"],
        float(stored["pull_share"]),
        int(stored["unknowns"]),
        view,
    )


def _arrays(found: PunchPad) -> dict[str, Any]:
    own = {name: getattr(found, name) for name in ("layers", "ratios", "exact", "relative")}
    view = {f"view_{name}": array for name, array in found.view.arrays().items()}
    numbers = {"pull_share": np.array(found.pull_share), "unknowns": np.array(found.unknowns)}
    return {**own, **numbers, **view}


def reduce_punch(pad: PadFile, advance: Callable[[], None] = lambda: None) -> PunchPad:
    """Mesh the pad, solve it at `SNAPSHOTS` ratios and return it in their shapes; ``advance`` once a solution."""
    full = full_punch_pad(pad)
    advance()
    ratios = chebyshev_ratios(*RATIOS, SNAPSHOTS)
    slides = pad.punch.contact == "frictionless"
    return reduce_full(full, ratios, np.array(pad.relative_moduli()), advance, slides=slides)


def reduce_full(
    full: ElasticPad,
    ratios: FloatArray,
    relative: FloatArray,
    advance: Callable[[], None] = lambda: None,
    *,
    slides: bool = False,
) -> PunchPad:
    """Solve a full mesh at ratios of core to epidermis (R,) and return it in the shapes of the answers.

    Under a punch that ``slides`` it is asked whether any skin would have to be pulled.
    """
    answers, forces = full.pressed(PUNCH, ratios, relative, advance)
    pulled = 0.0
    for ratio, answer in zip(ratios, answers, strict=True) if slides else ():
        moduli = np.array([relative[0], *(ratio * relative[1:])])
        pulled = max(pulled, full.pull_share(PUNCH, answer, moduli))
    gram = full.gram(answers, answers)
    gram = (gram + gram.transpose(0, 2, 1)) / 2
    combine = _shapes(gram)
    layers = np.einsum("am,lab,bn->lmn", combine, gram, combine)
    view = view_of(full.mesh, answers, combine, full.space)
    return PunchPad(layers, ratios, forces, relative, pulled, full.unknowns, view)


def _shapes(gram: FloatArray) -> FloatArray:
    """Return combinations (R, n) of answers with energies ``gram`` (L, R, R).

    The first is the middle answer, which moves the punch; the others are orthonormal combinations of what the
    answers differ by, which leave it where it is.
    """
    count = gram.shape[1]
    middle = count // 2
    differ = np.delete(np.eye(count), middle, axis=1)
    differ[middle] = -1.0
    inner = energy_basis(differ.T @ gram.sum(axis=0) @ differ, _ROUNDING)
    first = np.zeros((count, 1))
    first[middle] = 1.0
    return np.hstack([first, differ @ inner])
