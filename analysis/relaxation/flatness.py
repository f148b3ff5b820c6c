"""Whether the loading contradicts a flat punch: one step from a flat fit towards a free exponent.

The step is that of Gauss and Newton at exponent 1, in which all other parameters move along; near a flat
punch it is the exponent's least-squares estimate at the price of one evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.contact_law import ContactLaw
from analysis.relaxation.convex_response import convex_answer
from analysis.relaxation.noise import influences, neighbouring_noise, noise_covariance, widened


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
    residual_mn: FloatArray,
    reference_mm: float,
) -> Flatness:
    """Return the exponent that the loading of a flat fit says; arguments as in `RampSolution`."""
    answer = convex_answer(blocks, contact_mm, times_s.tolist(), ContactLaw(1.0, reference_mm))
    by_exponent = stiffness_mn_per_mm @ answer.exponent_slopes
    missed_mn = blocks.force_mn - stiffness_mn_per_mm @ answer.rows - offset_mn
    influence = influences(np.concatenate([jacobian, by_exponent[None]]), blocks.counts)[-1]
    doubted = widened(*noise_covariance(influence[None], blocks.edges, neighbouring_noise(residual_mn)))
    moved = float(influence @ (blocks.counts * missed_mn))
    return Flatness(1.0 + moved, influence, float(np.sqrt(doubted[0, 0])))
