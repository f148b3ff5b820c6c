"""The elements against answers that are known."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.fingertip.elastic import ElasticPad
from analysis.fingertip.meshing import PUNCH
from analysis.fingertip.punch import full_punch_pad
from analysis.fingertip.viscoelastic import Prony, Relaxation, relaxation

_NU, _RADIUS_MM = 0.48, 0.25


def test_patch_any_linear_displacement_is_answered_exactly(punch_mesh, bodies):
    """On the pad's own bent elements, with one Poisson's ratio and one modulus."""
    off, free = bodies.patch_test(punch_mesh)
    assert free > 1000
    assert off < 1e-10


def test_a_bar_of_springs_and_prony_slabs(bodies):
    """Without sideways strain three slabs are three springs in series; compared over the whole of a trial."""
    off, homogeneous = bodies.prony_bar()
    assert off < 1e-4
    assert homogeneous < 1e-9


@pytest.fixture(scope="module")
def half_space(bodies):
    """A half-space under a frictionless punch: the elements, their answer to 1 mm and the force."""
    mesh = bodies.half_space(_RADIUS_MM, 0.08, 0.02, 40.0, 2, PUNCH)
    full = ElasticPad(mesh, (_NU, _NU, _NU), held="bone", held_along_y=PUNCH)
    (answer,), force = full.pressed(PUNCH, np.array([1.0]), np.ones(3))
    return full, answer, force[0]


def test_a_punch_on_a_half_space(half_space):
    """Coarse here, 4 %; the benchmark refines it to 0.3 %."""
    assert half_space[2] == pytest.approx(2 * _RADIUS_MM / (1 - _NU**2), rel=0.04)


def test_a_frictionless_punch_is_softer_than_one_that_sticks(coarse_pad, punch):
    sliding = coarse_pad.model_copy(
        update={"punch": coarse_pad.punch.model_copy(update={"contact": "frictionless"})}
    )
    full = full_punch_pad(sliding)
    _, force = full.pressed(PUNCH, np.array([0.1, 1.0]), np.ones(3))
    sticking = [punch.stiffness(punch.layer_moduli(r)) for r in (0.1, 1.0)]
    assert (force < sticking).all()
    assert (force > 0.7 * np.array(sticking)).all()


def test_a_punch_that_slides_pulls_nowhere_and_one_that_is_lifted_does(half_space):
    full, answer, _ = half_space
    assert full.pull_share(PUNCH, answer, np.ones(3)) == 0.0
    lifted = answer.CreateVector()
    lifted.data = -1.0 * answer
    assert full.pull_share(PUNCH, lifted, np.ones(3)) == 1.0


def test_relaxation_times_lie_between_the_materials(punch):
    """A force held back by elastic layers relaxes more slowly than its material, never faster (Rayleigh)."""
    core = Prony(60.0, ((50.0, 2.0), (40.0, 0.15)))
    found: Relaxation = relaxation(punch.layers, [Prony(600.0), core, core])
    assert found.times_s.min() >= 0.15 * (1 - 1e-9)
    assert found.times_s.max() <= 2.0 * core.instantaneous_kpa / core.relaxed_kpa
