"""Whether the loading contradicts a flat punch: one step from a flat fit towards a free exponent.

The step is that of Gauss and Newton at exponent 1, in which all other parameters move along; near a flat
punch it is the exponent's least-squares estimate at the price of one evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.block_response import block_rows
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.contact_law import ContactLaw
from analysis.relaxation.noise import NoiseSpectrum, white_error


@dataclass(frozen=True, slots=True)
class Flatness:
    """The exponent one step from a flat fit, and ``influence`` (K,) of a sample in each block on it.

    ``doubted_se`` is its standard error where only what differs between neighbours counts as noise, so that
    the misfit of a wrong law can't excuse itself.
    """

    exponent: float
    influence: FloatArray
    doubted_se: float


def ask_flatness(
    blocks: Blocks,
    contact_mm: float,
    times_s: FloatArray,
    stiffness_mn_per_mm: FloatArray,
    offset_mn: float,
    *,
    jacobian: FloatArray,
    influence: FloatArray,
    doubted: NoiseSpectrum,
    reference_mm: float,
) -> Flatness:
    """Return the exponent that the loading of a flat fit says; arguments as in `RampSolution`.

    ``influence`` (P, K) is that of a sample on the flat fit's parameters. The first rows of the ``jacobian`` (P, K)
    are those of depth, arms and the constant 1.
    """
    n = len(stiffness_mn_per_mm)
    slope = ContactLaw(1.0, reference_mm).exponent_slope
    by_exponent = stiffness_mn_per_mm @ block_rows(blocks, contact_mm, times_s.tolist(), slope)
    missed_mn = blocks.force_mn - stiffness_mn_per_mm @ jacobian[:n] - offset_mn
    # what of it the other parameters can't imitate
    own = by_exponent - (influence @ (blocks.counts * by_exponent)) @ jacobian
    own_influence = own / max(float(np.sum(blocks.counts * np.square(own))), 1e-300)
    moved = float(own_influence @ (blocks.counts * missed_mn))
    return Flatness(1.0 + moved, own_influence, white_error(own_influence, blocks.edges, doubted))
