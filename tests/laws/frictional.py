"""Collisions with friction that tests of laws share."""

import numpy as np

from impactlaw import Collision, Friction


def one_contact(rng: np.random.Generator, directions: int = 1, largest: float = 2.0) -> Collision:
    """A random system of up to six degrees of freedom, one contact, and its directions of sliding."""
    nv = int(rng.integers(1 + directions, 7))
    A = rng.normal(size=(nv, nv))
    rows = Friction(rng.normal(size=(directions, nv)), [0] * directions, [rng.uniform(0.01, largest)] * directions)
    J, v = rng.normal(size=(1, nv)), rng.normal(size=nv)
    J = J * -np.sign(J @ v)[0]
    return Collision(A @ A.T + 0.05 * np.eye(nv), J, v, friction=rows)


def several_contacts(rng: np.random.Generator, h: int, directions: int = 2) -> Collision:
    """Independent contacts of a random system."""
    nv = h * (1 + directions) + int(rng.integers(0, 3))
    A = rng.normal(size=(nv, nv))
    mu = np.repeat(rng.uniform(0.01, 1.5, h), directions)
    rows = Friction(rng.normal(size=(len(mu), nv)), np.repeat(np.arange(h), directions), mu)
    return Collision(A @ A.T + 0.05 * np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv), friction=rows)


def delassus_with_friction(c: Collision) -> tuple[np.ndarray, np.ndarray]:
    """G and contact velocities before of normals, then of sliding."""
    J = np.vstack([c.jacobian, c.friction.jacobian])
    return J @ np.linalg.solve(c.mass_matrix, J.T), J @ c.pre_velocity
