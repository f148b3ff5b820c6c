"""Drainage from under a flat punch: the published relaxation, as a sum of arms."""

from __future__ import annotations

import numpy as np

from analysis.simulation.mechanisms.poroelastic_drainage import RATES, WEIGHTS


def test_arms_add_up_to_the_published_relaxation() -> None:
    """Of 60 mN/mm a hundredth, at 0.8 mm, is half a millinewton: twice the noise. All times from a 5000th of T."""
    u = np.geomspace(2e-4, 50.0, 2000)
    published = 1.304 * np.exp(-np.sqrt(u)) - 0.304 * np.exp(-0.254 * u)
    summed = 1.304 * np.exp(-np.outer(u, RATES)) @ WEIGHTS - 0.304 * np.exp(-0.254 * u)
    np.testing.assert_allclose(summed, published, atol=1e-3)
    assert WEIGHTS.sum() == 1.0
