"""The elements against answers that are known."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from analysis.fingertip.elastic import ElasticPad
from analysis.fingertip.meshing import PUNCH, mesh_pad
from analysis.fingertip.punch import reduce_full
from analysis.fingertip.viscoelastic import Prony, Relaxation, relaxation


@pytest.fixture(scope="module")
def bodies():
    path = Path(__file__).with_name("known_bodies.py")
    spec = importlib.util.spec_from_file_location("known_bodies", path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_patch_any_linear_displacement_is_answered_exactly(coarse_pad):
    """On the pad's own bent elements, with one Poisson's ratio and one modulus."""
    from ngsolve import CF, GridFunction, x, y, z

    mesh = mesh_pad(coarse_pad, "punch")
    full = ElasticPad(mesh, (0.48, 0.48, 0.48), held=".*")
    wanted, answer = GridFunction(full.space), GridFunction(full.space)
    slopes = np.array([[0.3, 0.1, 0.0], [-0.2, 0.5, 0.4], [0.1, -0.3, 0.2]])
    linear = CF(tuple(sum(float(a) * c for a, c in zip(row, (x, y, z), strict=True)) for row in slopes))
    wanted.Interpolate(linear)
    answer.vec.data = wanted.vec
    # nothing of the answer is left inside, so that it has to be solved for
    free = np.array([bool(b) for b in full.space.FreeDofs()])
    answer.vec.FV().NumPy()[free] = 0.0
    matrix = full.mixture([1.0, 1.0, 1.0])
    residual = answer.vec.CreateVector()
    residual.data = matrix * answer.vec
    answer.vec.data -= full.inverse(matrix) * residual
    off = np.abs(answer.vec.FV().NumPy() - wanted.vec.FV().NumPy()).max()
    assert free.sum() > 1000
    assert off < 1e-10 * np.abs(wanted.vec.FV().NumPy()).max()


def test_a_bar_of_springs_and_prony_slabs(bodies):
    """Without sideways strain three slabs are three springs in series; compared over the whole of a trial."""
    full = ElasticPad(bodies.bar(), (0.0, 0.0, 0.0), held=f"{PUNCH}|bone")
    found = reduce_full(full, np.geomspace(0.03, 3, 6), np.array([1.0, 1.0, 1.0]))
    epidermis, core = Prony(30.0), Prony(3.0, ((4.0, 2.0), (2.0, 0.15)))
    answer = relaxation(found.layers, [epidermis, core, core])
    # the same by hand: compliances add up in Laplace's domain, and its inverse is taken by Talbot's contour
    time_s = np.geomspace(1e-2, 20, 30)

    def stiffness(s):
        soft = core.relaxed_kpa + sum(m * s / (s + 1 / tau) for m, tau in core.arms)
        return 1 / (1 / (3 * 30.0) + 2 / (3 * soft))

    by_hand = [_talbot(lambda s: stiffness(s) / s, t) for t in time_s]
    np.testing.assert_allclose(answer.after_step(time_s), by_hand, rtol=1e-4)
    homogeneous = relaxation(found.layers, [core] * 3)
    np.testing.assert_allclose(homogeneous.after_step(time_s), core.at(time_s), rtol=1e-9)


def _talbot(transform, time_s, count=32):
    """Abate and Whitt (2006): the fixed Talbot sum for the inverse of a Laplace transform."""
    angles = np.arange(1, count) * np.pi / count
    cot = 1 / np.tan(angles)
    delta = np.append(2 * count / 5, 2 * np.pi * np.arange(1, count) / 5 * (cot + 1j))
    gamma = np.append(
        np.exp(delta[0]) / 2,
        (1 + 1j * angles * (1 + cot**2) - 1j * cot) * np.exp(delta[1:]),
    )
    return 0.4 / time_s * sum((g * transform(d / time_s)).real for g, d in zip(gamma, delta, strict=True))


def test_a_punch_on_a_half_space(bodies):
    """Coarse here, 4 %; the benchmark refines it to 0.3 %."""
    nu, radius_mm = 0.48, 0.25
    mesh = bodies.half_space(radius_mm, 0.08, 0.02, 40.0, 2, PUNCH)
    full = ElasticPad(mesh, (nu, nu, nu), held="bone", held_along_y=PUNCH)
    _, force = full.pressed(PUNCH, np.array([1.0]), np.ones(3))
    assert force[0] == pytest.approx(2 * radius_mm / (1 - nu**2), rel=0.04)


def test_a_frictionless_punch_is_softer_than_one_that_sticks(coarse_pad, punch):
    from analysis.fingertip.punch import full_punch_pad

    sliding = coarse_pad.model_copy(
        update={"punch": coarse_pad.punch.model_copy(update={"contact": "frictionless"})}
    )
    full = full_punch_pad(sliding)
    _, force = full.pressed(PUNCH, np.array([0.1, 1.0]), np.ones(3))
    sticking = [punch.stiffness(punch.layer_moduli(r)) for r in (0.1, 1.0)]
    assert (force < sticking).all()
    assert (force > 0.7 * np.array(sticking)).all()


def test_a_punch_that_slides_pulls_nowhere_and_one_that_is_lifted_does(bodies):
    mesh = bodies.half_space(0.25, 0.08, 0.02, 40.0, 2, PUNCH)
    full = ElasticPad(mesh, (0.48, 0.48, 0.48), held="bone", held_along_y=PUNCH)
    (answer,), _ = full.pressed(PUNCH, np.array([1.0]), np.ones(3))
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
