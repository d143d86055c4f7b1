"""A car whose wheels touch the floor at both of their ends: it can share friction in many ways."""

import numpy as np
import pytest
from solvers.cones.problems import problem

from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.solve import solve

H, RADIUS, HEIGHT = 0.004, 0.05, 0.08
MASS = np.array([1.6, 1.6, 1.6, 0.005, 0.02, 0.02, 4e-4, 4e-4, 2e-4, 2e-4, 5e-4])
"""kg and kg m^2; after the body the steering and the spin of the front wheels, and the spin of the rear axle."""
FRICTION = np.array([1.0, 1.0, 1.0, 5e-3, 1e-4, 1e-4])


def rows():
    """Return the whitened rows of the rod that couples the steering, and of eight contacts, (49, 11)."""
    found = [np.eye(11)[6:7] - np.eye(11)[7:8]]
    for x, y, steering, spin in ((0.15, -0.1, 6, 8), (0.15, 0.1, 7, 9), (-0.15, -0.1, 10, 10), (-0.15, 0.1, 10, 10)):
        for end in (-0.02, 0.02):
            at, J = np.array([x, y + end, -HEIGHT]), np.zeros((6, 11))
            for row, axis in enumerate(np.eye(3)[[2, 0, 1]]):
                J[row, :6] = np.concatenate([axis, np.cross(at, axis)])
                J[3 + row, 3:6] = axis
            J[1, spin], J[5, spin] = -RADIUS, 1.0
            if steering != spin:
                J[1, steering], J[3, steering] = -end, 1.0
            found.append(FRICTION[:, None] * J)
    return np.vstack(found) / np.sqrt(MASS)


def drive(seed, every):
    """Drive with other motors after a number of steps; return the natural map and the Newton steps of each step."""
    rng, Y, told = np.random.default_rng(seed), rows(), []
    velocity, impulse, force = np.zeros(11), np.zeros(49), np.zeros(11)
    for step in range(100):
        if step % every == 0:
            force[[2, 6, 10]] = -9.81 * MASS[2], 0.2 * rng.normal(), 0.1 * rng.normal()
        free = velocity + H * force / np.sqrt(MASS)
        *known, b = problem(Y, [1] + [6] * 8, [BILATERAL] + [CONE] * 8, Y @ free)
        impulse, jump, residual, steps = solve(*known, b, impulse, True, 1e-10, 8, 1.0)
        velocity = free + jump
        told.append((residual, steps))
    return told


@pytest.mark.parametrize(("every", "most"), [(1, 35), (10, 7.5)])
def test_a_car_takes_few_newton_steps_from_its_last_impulses(every, most):
    """Without regularization near the guess there were 40 and 10 on average."""
    residual, steps = np.array([told for seed in range(4) for told in drive(seed, every)]).T
    assert residual.max() <= 1e-10
    assert steps.mean() < most
