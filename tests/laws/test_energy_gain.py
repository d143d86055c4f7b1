"""How much kinetic energy a restitution matrix can create; isometries are elastic."""

import numpy as np
import pytest
from problems import PROBLEMS, SWAPPED, balls, box, launched

from impactlaw import Collision, Fremond, energy_gain
from impactlaw.errors import InvalidCollisionError, RestitutionError


def all_active(rng, E, c):
    """Return the collision whose gamma- gives every contact an impulse: Lambda = -G^-1 (1 + E) gamma- > 0."""
    h = len(c.labels)
    gamma = -np.linalg.solve(np.eye(h) + E, c.delassus @ rng.uniform(0.1, 1.0, h))
    return Collision(c.mass_matrix, c.jacobian, np.linalg.pinv(c.jacobian) @ gamma)


def random_contacts(rng):
    h = int(rng.integers(1, 7))
    nv = h + int(rng.integers(0, 3))
    A = rng.normal(size=(nv, nv))
    return Collision(A @ A.T + 0.1 * np.eye(nv), rng.normal(size=(h, nv)), np.zeros(nv))


@pytest.mark.parametrize("seed", range(40))
def test_isometry_is_elastic(seed):
    rng = np.random.default_rng([21, seed])
    c = random_contacts(rng)
    d, V = np.linalg.eigh(c.delassus)
    root = (V * np.sqrt(d)) @ V.T
    Q = np.linalg.qr(rng.normal(size=root.shape))[0]
    Q[:, 0] *= np.linalg.det(Q)  # a rotation: a reflection would leave some gamma- unchanged
    E = root @ Q @ np.linalg.inv(root)
    assert energy_gain(c, E) == pytest.approx(1.0, rel=1e-8)
    c = all_active(rng, E, c)
    impact = Fremond(E).resolve(c)
    assert (impact.impulse > 0).all()
    assert impact.energy_change == pytest.approx(0.0, abs=1e-8 * c.kinetic_energy)


@pytest.mark.parametrize("seed", range(40))
def test_energy_gain_decides_whether_a_matrix_dissipates(seed):
    """E^T G^-1 E <= G^-1 iff energy_gain <= 1; no collision with all contacts active gains more than energy_gain."""
    rng = np.random.default_rng([22, seed])
    c = random_contacts(rng)
    h = len(c.labels)
    E = rng.normal(size=(h, h)) * rng.uniform(0.1, 1.0) / np.sqrt(h)
    inverse = np.linalg.inv(c.delassus)
    gain = energy_gain(c, E)
    assert gain == pytest.approx(np.linalg.eigvals(c.delassus @ E.T @ inverse @ E).real.max(), rel=1e-7)
    smallest = np.linalg.eigvalsh(inverse - E.T @ inverse @ E).min()
    assert (gain <= 1) == (smallest >= 0)
    c = all_active(rng, E, c)
    impact = Fremond(E).resolve(c)
    before, after = (
        0.5 * g @ inverse @ g for g in (impact.collision.pre_contact_velocity, impact.post_contact_velocity)
    )
    assert after <= gain * before * (1 + 1e-7)
    assert impact.energy_change == pytest.approx(after - before, abs=1e-7 * before)


def test_energy_gain_of_named_matrices():
    c = launched(3, 1)
    assert energy_gain(c, SWAPPED) == pytest.approx(1.0, abs=1e-12)
    assert energy_gain(c, 0.6 * np.eye(2)) == pytest.approx(0.36, abs=1e-12)
    assert energy_gain(c, [[0.0, 2.0], [0.0, 0.0]]) == pytest.approx(16 / 3, abs=1e-12)  # G = [[2, -1], [-1, 2]]
    assert energy_gain(box(), 0.5 * np.eye(4)) == pytest.approx(0.25, abs=1e-12)
    assert energy_gain(PROBLEMS["no contact"](), np.zeros((0, 0))) == 0.0
    assert energy_gain(Collision(np.eye(1), [[0.0]], [1.0]), [[1.0]]) == 0.0
    unequal = balls([1e-6, 1e6, 1e-6], [0.0, 0.0, 0.0])
    scaled = Collision(unequal.mass_matrix, np.diag([1e3, 1e-3]) @ unequal.jacobian, [0.0, 0.0, 0.0])
    assert energy_gain(scaled, 0.5 * np.eye(2)) == pytest.approx(0.25, abs=1e-9)
    with pytest.raises(RestitutionError, match=r"\(3, 3\) for 2 contacts"):
        energy_gain(c, np.eye(3))


def test_no_collision_gains_energy():
    with pytest.raises(InvalidCollisionError, match="this takes a Collision, got None"):
        energy_gain(None, [[1]])
