"""Collisions with friction shared by tests of laws."""

import numpy as np

from impactlaw import Collision, Friction


def one_contact(rng: np.random.Generator, directions: int = 1, largest: float = 2.0) -> Collision:
    """Return a random system of up to six degrees of freedom with one contact and its sliding directions."""
    nv = int(rng.integers(1 + directions, 7))
    A = rng.normal(size=(nv, nv))
    rows = Friction(rng.normal(size=(directions, nv)), [0] * directions, [rng.uniform(0.01, largest)] * directions)
    J, v = rng.normal(size=(1, nv)), rng.normal(size=nv)
    J = J * -np.sign(J @ v)[0]
    return Collision(A @ A.T + 0.05 * np.eye(nv), J, v, friction=rows)


def several_contacts(rng: np.random.Generator, h: int, directions: int = 2) -> Collision:
    """Return independent contacts of a random system."""
    nv = h * (1 + directions) + int(rng.integers(0, 3))
    A = rng.normal(size=(nv, nv))
    mu = np.repeat(rng.uniform(0.01, 1.5, h), directions)
    rows = Friction(rng.normal(size=(len(mu), nv)), np.repeat(np.arange(h), directions), mu)
    return Collision(A @ A.T + 0.05 * np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv), friction=rows)


def delassus_with_friction(c: Collision) -> tuple[np.ndarray, np.ndarray]:
    """Return G and the contact velocities before, of the normals first, then of the sliding directions."""
    J = np.vstack([c.jacobian, c.friction.jacobian])
    return J @ np.linalg.solve(c.mass_matrix, J.T), J @ c.pre_velocity


def friction_problem(rng: np.random.Generator, most: int = 12, ratio: float = 1e6):
    """Return whitened gradients, offset, rows per contact and speed of boxes that touch each other and the ground.

    There are up to ``most`` contacts, without friction or with sliding, torsional and rolling friction. Coefficients
    are 0.01 to 2, mass ratios up to ``ratio``. Some boxes stand flat on four corners, so that contacts are redundant.
    """
    h = int(rng.integers(1, most + 1))
    bodies = int(rng.integers(1, h // 2 + 2))
    mass = ratio ** rng.uniform(-0.5, 0.5, bodies) if rng.random() < 0.5 else rng.uniform(0.5, 2.0, bodies)
    size = rng.uniform(0.2, 1.0, bodies)
    flat = rng.random() < 0.4
    blocks, sizes = [], []
    for k in range(h):
        i, j = int(rng.integers(bodies)), int(rng.integers(-1, bodies))
        normal = np.array([0.0, 0.0, 1.0]) if flat else rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        corner = np.array([2.0 * (k % 2) - 1.0, 2.0 * (k // 2 % 2) - 1.0, -1.0])
        frame = np.linalg.qr(np.column_stack([normal, rng.normal(size=(3, 2))]))[0].T
        frame[0] = normal
        d = int(rng.choice([0, 2, 3, 5], p=[0.1, 0.6, 0.15, 0.15]))
        mu = 10.0 ** rng.uniform(-2.0, 0.3)
        block = np.zeros((6, 6 * bodies))
        for body, sign in ((i, 1.0), (j if j != i else -1, -1.0)):
            if body >= 0:
                arm = size[body] * (sign * corner if flat else -sign * normal + 0.2 * rng.normal(size=3))
                at = 6 * body
                block[:3, at : at + 3] += sign * frame
                block[:3, at + 3 : at + 6] += sign * np.cross(arm, frame)
                block[3:, at + 3 : at + 6] += sign * frame
        blocks.append((block * np.array([1.0, mu, mu, 0.1 * mu, 0.03 * mu, 0.03 * mu])[:, None])[: d + 1])
        sizes.append(d + 1)
    inertia = np.concatenate([[m] * 3 + [0.4 * m * s**2] * 3 for m, s in zip(mass, size, strict=True)])
    A, sizes = np.vstack(blocks) / np.sqrt(inertia), np.array(sizes)
    normals = A[np.cumsum(sizes) - sizes]
    z = rng.normal(size=A.shape[1])
    if rng.random() < 0.6:
        closing = np.abs(rng.normal(size=h)) * np.linalg.norm(normals, axis=1)
        z = 0.5 * z - np.linalg.lstsq(normals, closing, rcond=None)[0]
    return A, A @ z, sizes, float(np.linalg.norm(z))


def friction_collision(rng: np.random.Generator, most: int = 12, ratio: float = 1e6) -> Collision:
    """Return the collision of `friction_problem` in whitened coordinates; every contact has friction."""
    A, _, sizes, speed = friction_problem(rng, most, ratio)
    first = np.cumsum(sizes) - sizes
    normal = np.zeros(len(A), dtype=bool)
    normal[first] = True
    contact = np.repeat(np.arange(len(sizes)), sizes)[~normal]
    lengths = np.linalg.norm(A[~normal], axis=1)
    mu = 10.0 ** rng.uniform(-2.0, 0.3, len(contact))
    friction = Friction(A[~normal] / np.where(lengths > 0, lengths, 1.0)[:, None], contact, mu)
    v = rng.normal(size=A.shape[1])
    return Collision(np.eye(A.shape[1]), A[first], v * speed / np.linalg.norm(v), friction=friction)
