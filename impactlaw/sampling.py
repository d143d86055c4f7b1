"""Uniform samples of a capped polyhedron, by hit-and-run chains that run side by side."""

from __future__ import annotations

import numpy as np

from impactlaw.capped_polyhedron import CappedPolyhedron

_FLAT = 1e-9  # width below which the set has no extent in a direction
_TIGHT = 1e-11  # slack in the middle of the set that only constraints without extent have


def uniform_samples(body: CappedPolyhedron, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n independent points, uniform in the set within its affine hull, shape (n, r).

    Each is the end of its own hit-and-run chain (Smith 1984): from a point of the set a random direction, then a
    uniform point of the chord. Directions are drawn where the set is about as wide as it is long, and there are
    enough steps for `tests/test_admissible.py` not to tell the samples from exact ones.
    """
    middle, edges = _inner_simplex(body, rng)
    d = len(edges)
    slack = body.normals @ middle - body.offsets
    cuts = slack > _TIGHT
    A, b, c = body.normals[cuts], body.offsets[cuts], body.center
    x = np.tile(middle, (n, 1))
    for _ in range(_steps(d)):
        step = rng.standard_normal((n, d)) @ edges
        low, high = _chord(x, step, A, b, c)
        x += (low + (high - low) * rng.random(n))[:, None] * step
    return x


def _steps(d: int) -> int:
    return 1 if d == 1 else (0 if d == 0 else 20 + 10 * d)


def _inner_simplex(body: CappedPolyhedron, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a point in the relative interior of the set, and as many of its chords as its affine hull has dimensions.

    Each direction is orthogonal to the chords before it and to the directions that turned out to be flat.
    """
    r = len(body.center)
    points, edges, done = [body.inside], [], np.zeros((0, r))
    for _ in range(r):
        direction = rng.standard_normal(r)
        for _ in range(2):
            direction -= (done @ direction) @ done
            direction /= np.linalg.norm(direction)
        ends = body.extreme(direction), body.extreme(-direction)
        edge = ends[0] - ends[1]
        if direction @ edge > _FLAT:
            points += ends
            edges.append(edge)
            edge = edge - (done @ edge) @ done
            done = np.vstack([done, edge / np.linalg.norm(edge)])
        else:
            done = np.vstack([done, direction])
    return np.mean(points, axis=0), np.reshape(edges, (-1, r))


def _chord(
    x: np.ndarray, step: np.ndarray, A: np.ndarray, b: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and largest t, each (n,), for which ``x + t step`` keeps ``A x >= b`` and stays in the ball."""
    slack = np.maximum(x @ A.T - b, 0.0)
    rate = step @ A.T
    t = np.divide(-slack, rate, out=np.full_like(rate, np.inf), where=rate != 0)
    low = np.where(rate > 0, t, -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(rate < 0, t, np.inf).min(axis=1, initial=np.inf)
    square = np.einsum("ij,ij->i", step, step)
    half = np.einsum("ij,ij->i", x - c, step)
    depth = np.minimum(np.einsum("ij,ij->i", x, x - 2.0 * c), 0.0)
    far = -half - np.copysign(np.sqrt(half**2 - square * depth), half)
    one, two = far / square, np.divide(depth, far, out=np.zeros_like(far), where=far != 0)
    return np.maximum(low, np.minimum(one, two)), np.minimum(high, np.maximum(one, two))
