"""Collisions made by a known law, for tests of identification."""

import numpy as np

from impactlaw import Collision, Fremond


def system(h: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a mass matrix, h independent gradients, and E with ``|G^-1/2 E G^1/2|_2`` below 1."""
    nv = h + 2
    A, J = rng.normal(size=(nv, nv)), rng.normal(size=(h, nv))
    M = A @ A.T + np.eye(nv)
    w, V = np.linalg.eigh(J @ np.linalg.solve(M, J.T))
    root, inverse = (V * np.sqrt(w)) @ V.T, (V / np.sqrt(w)) @ V.T
    F = rng.normal(size=(h, h))
    return M, J, root @ (F / (1.05 * np.linalg.norm(F, 2))) @ inverse


def active_collisions(h: int, n: int, seed: int, noise: float = 0.0):
    """Return E and collisions with ``gamma+ = -E gamma-``, each contact with an impulse, with relative errors."""
    rng = np.random.default_rng(seed)
    M, J, E = system(h, rng)
    G, R = J @ np.linalg.solve(M, J.T), np.linalg.cholesky(M)
    labels = tuple(f"c{i}/floor" for i in range(h))
    collisions, after = [], []
    for _ in range(n):
        impulse = rng.exponential(size=h)  # gamma+ - gamma- = G Lambda = -(1 + E) gamma-
        v = np.linalg.lstsq(J, np.linalg.solve(np.eye(h) + E, -G @ impulse), rcond=None)[0]
        c = Collision(M, J, v, labels=labels)
        post = v + np.linalg.solve(M, J.T @ impulse)
        collisions.append(c)
        after.append(post + noise * c.pre_speed * np.linalg.solve(R.T, rng.normal(size=len(v))))
    return E, collisions, after


def open_collisions(h: int, n: int, seed: int):
    """Return E and collisions resolved by it from random velocities; some contacts open without an impulse."""
    rng = np.random.default_rng(seed)
    M, J, E = system(h, rng)
    collisions = [Collision(M, J, rng.normal(size=h + 2)) for _ in range(n)]
    return E, collisions, [Fremond(E).resolve(c).post_velocity for c in collisions]
