"""Audits of bodies on several feet, with redundant friction and weak torsion and rolling."""

from __future__ import annotations

import numpy as np
import pytest

from impactlaw import Collision, Coulomb, Friction, FrictionImpact, MaximalDissipation

HIPS = np.array([[x, y, -0.5] for x in (0.3, -0.3) for y in (0.2, -0.2)])
MU = [0.8, 0.8, 0.02, 1e-4, 1e-4]  # sliding, torsion, rolling


def feet(rng: np.random.Generator) -> Collision:
    """Return a body of 30 kg on four legs with three joints each, at a random velocity."""
    normal, rubbing = [], []
    for i, hip in enumerate(HIPS):
        move, turn = np.zeros((2, 3, 18))
        move[:, :3] = turn[:, 3:6] = np.eye(3)
        move[:, 3:6] = np.cross(np.eye(3), hip).T
        move[:, 6 + 3 * i : 9 + 3 * i] = rng.normal(size=(3, 3))
        normal.append(move[2])
        rubbing += [move[0], move[1], turn[2], turn[0], turn[1]]
    M = np.diag([30, 30, 30, 1, 2, 2] + 12 * [0.1])
    friction = Friction(np.array(rubbing), np.repeat(np.arange(4), 5), np.tile(MU, 4))
    return Collision(M, np.array(normal), rng.normal(size=18), friction=friction)


@pytest.mark.parametrize("seed", [170, 196, 429, 459, 517, 675, 708, 1055, 1131, *range(10)])
def test_the_impulse_is_the_nearest_one_in_the_friction_cones(seed: int):
    rng = np.random.default_rng(seed)
    c = feet(rng)
    v = Coulomb(MaximalDissipation()).resolve(c).post_velocity
    for near in (v + 0.01 * rng.normal(size=18), v + 0.1 * rng.normal(size=18), 0.9 * v):
        impact = FrictionImpact.observed(c, near)
        Y, T = c.whitened_jacobian, c.whitened_friction
        x, y = impact.impulse, impact.friction_impulse.reshape(4, 5)
        left = Y.T @ x + T.T @ y.ravel() - impact.whitened_jump
        along = np.linalg.norm(MU * (T @ left).reshape(4, 5), axis=1)
        assert (np.linalg.norm(y / MU, axis=1) <= x * (1 + 1e-9)).all()
        assert (Y @ left >= along - 1e-8).all()  # no impulse in the cones leads closer
        assert abs(left @ (left + impact.whitened_jump)) <= 1e-6
