"""A sphere with friction on the ground."""

import numpy as np

from impactlaw import (
    Collision,
    Friction,
)


def sphere(velocity, mu, *, mass=2.0, radius=0.5, torsion=0.0, rolling=0.0) -> Collision:
    """Return a solid sphere that hits the floor below it; velocity is (x, y, z, and the angular velocity)."""
    M = np.diag([mass] * 3 + [0.4 * mass * radius**2] * 3)
    r = np.array([0.0, 0.0, -radius])
    point = np.hstack([np.eye(3), -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])])
    turn = np.hstack([np.zeros((3, 3)), np.eye(3)])
    rows, mus = [point[0], point[1]], [mu, mu]
    if torsion:
        rows, mus = [*rows, turn[2]], [*mus, torsion]
    if rolling:
        rows, mus = [*rows, turn[0], turn[1]], [*mus, rolling, rolling]
    return Collision(M, point[2:], velocity, friction=Friction(np.array(rows), np.zeros(len(rows), dtype=int), mus))
