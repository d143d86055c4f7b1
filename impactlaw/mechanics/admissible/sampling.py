"""Uniform samples of a capped polyhedron: by rejection in few dimensions, else by parallel hit-and-run chains."""

from __future__ import annotations

from numbers import Integral

import numpy as np

from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.admissible.capped_polyhedron import CappedPolyhedron
from impactlaw.mechanics.tolerances import FLAT, TIGHT

_PILOTS = 10  # chains per dimension that measure the shape of the set
_TRIALS = 512  # points of the ball tried at once
_FRUITLESS = 2  # rounds without a point of the set after which chains take over
_MOST = 2**20  # most points tried when many samples are wanted


def check_number(n: object) -> None:
    """Raise `InvalidCollisionError` unless n is a whole number, 0 or more."""
    if not isinstance(n, Integral) or n < 0:
        raise InvalidCollisionError(f"n must be a whole number, 0 or more, got {n!r}")


def generator_of(rng: np.random.Generator | int) -> np.random.Generator:
    """Return the generator, or one made from a seed; raise `InvalidCollisionError` if it is neither."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        raise InvalidCollisionError(f"rng is a numpy generator, or a seed for one, got {rng!r:.100}") from None


def uniform_samples(body: CappedPolyhedron, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n independent points, uniform in the set with respect to the volume of its affine hull, shape (n, r)."""
    found = _rejection(body, n, rng)
    missing = n - len(found)
    return np.vstack([found, _chains(body, missing, rng)]) if missing else found


def _rejection(body: CappedPolyhedron, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return up to n uniform points, (k, r): those of uniform points in the ball that are in the set."""
    r, tried, found = len(body.center), 0, np.zeros((0, len(body.center)))
    size = float(np.linalg.norm(body.center))
    while len(found) < n:
        if tried >= _FRUITLESS * _TRIALS and tried * n > len(found) * _MOST:
            break
        ray = rng.standard_normal((_TRIALS, r))
        length = size * rng.random(_TRIALS) ** (1.0 / r) / np.sqrt(np.vecdot(ray, ray))
        x = body.center + length[:, None] * ray
        found = np.vstack([found, x[(x @ body.normals.T >= body.offsets).all(axis=1)]])
        tried += _TRIALS
    return found[:n]


def _chains(body: CappedPolyhedron, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n points, (n, r), each the end of its own hit-and-run chain (R. L. Smith 1984).

    Each step of a chain draws a random direction and then a uniform point on the chord of the set. Pilot chains first
    measure the shape of the set, and directions are then drawn with the covariance of that shape. Chains have
    ``20 + 10 d`` steps in d dimensions: with 20 000 samples of an orthant of the ball, Kolmogorov's test finds no
    deviation up to d = 12.
    """
    middle, edges = _inner_simplex(body, rng)
    d = len(edges)
    if d == 0:
        return np.tile(middle, (n, 1))
    cuts = body.normals @ middle - body.offsets > TIGHT
    open_body = CappedPolyhedron(body.normals[cuts], body.offsets[cuts], body.center, middle)
    steps = 1 if d == 1 else 20 + 10 * d  # one step across a segment is exact
    pilots = _walk(open_body, np.tile(middle, (_PILOTS * d, 1)), edges, steps, rng)
    middle = pilots.mean(axis=0)
    _, spread, axes = np.linalg.svd(pilots - middle, full_matrices=False)
    return _walk(open_body, np.tile(middle, (n, 1)), spread[:d, None] * axes[:d], steps, rng)


def _inner_simplex(body: CappedPolyhedron, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a point in the relative interior of the set, and as many chords of it as it has dimensions, (d, r).

    Each chord joins the extreme points in a direction orthogonal to all earlier directions, also to those in which the
    set is flat.
    """
    r = len(body.center)
    points, edges, done = [body.inside], [], np.zeros((0, r))
    for _ in range(r):
        direction = _orthogonal(rng.standard_normal(r), done)
        ends = body.extreme(direction), body.extreme(-direction)
        edge = ends[0] - ends[1]
        if direction @ edge > FLAT:
            points += ends
            edges.append(edge)
            direction = _orthogonal(edge, done)
        done = np.vstack([done, direction])
    return np.mean(points, axis=0), np.reshape(edges, (-1, r))


def _orthogonal(vector: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the unit vector along the part of the vector that is orthogonal to the orthonormal rows."""
    for _ in range(2):  # the second time to remove the rounding errors of the first
        vector = vector - (rows @ vector) @ rows
        vector = vector / np.linalg.norm(vector)
    return vector


def _walk(body: CappedPolyhedron, x: np.ndarray, edges: np.ndarray, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Move each point, (n, r), ``steps`` times to a uniform point of the chord along a random sum of the edges.

    The coefficients of the sum are normally distributed.
    """
    n = len(x)
    for _ in range(steps):
        ray = rng.standard_normal((n, len(edges))) @ edges
        low, high = _chord(body, x, ray)
        x = x + (low + (high - low) * rng.random(n))[:, None] * ray
    return x


def _chord(body: CappedPolyhedron, x: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest t, (n,) each, with ``x + t ray`` in the set, for points x of the set."""
    rate = ray @ body.normals.T
    room = np.maximum(x @ body.normals.T - body.offsets, 0.0)
    t = np.divide(-room, rate, out=np.zeros_like(rate), where=rate != 0)
    low = np.where(rate > 0, t, -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(rate < 0, t, np.inf).min(axis=1, initial=np.inf)
    # the ball: square t^2 + 2 half t + excess <= 0 with excess <= 0; the roots are computed without cancellation
    square = np.einsum("ij,ij->i", ray, ray)
    half = np.einsum("ij,ij->i", x - body.center, ray)
    excess = np.minimum(body.excess(x), 0.0)
    far = -half - np.copysign(np.sqrt(half**2 - square * excess), half)
    near = np.divide(excess, far, out=np.zeros_like(far), where=far != 0)
    roots = np.sort([far / square, near], axis=0)
    return np.maximum(low, roots[0]), np.minimum(high, roots[1])
