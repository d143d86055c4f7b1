"""The cone of the gap gradients, ``{Y^T Lambda : Lambda >= 0}``: nearest points and facets."""

from __future__ import annotations

from math import comb

import numpy as np
from scipy.linalg import qr, solve
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from impactlaw.errors import ImpactLawError, SolverError

MAX_FACETS = 20_000
"""Most facets that a group of dependent gradients may have (upper bound theorem) before they are not listed."""
_ZERO = 1e-11  # coefficient of unit gradients, or offset of a facet, that counts as rounding
_ROUNDING = 2e-15  # pull on a generator, relative to the point, that counts as zero
_RANK = 1e-11  # relative singular value below which generators count as dependent


class EnumerationError(ImpactLawError):
    """A set has too many faces to list them: too many redundant gradients of too high a rank."""


def nearest_in_cone(generators: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return ``Lambda >= 0`` that minimises ``|Y^T Lambda - point|``, shape (h,), for unit rows Y.

    Lawson and Hanson's active set: let in the generator that the remainder pulls on most, then take out those that
    would become negative. scipy 1.17's `nnls` is the same method but returns wrong answers where a generator depends
    on those that are in, as opposing contacts do (https://github.com/scipy/scipy/pull/26180).

    Raises:
        SolverError: not finished after ten changes per generator.
    """
    h, scale = len(generators), float(np.linalg.norm(point))
    weights, used, refused = np.zeros(h), np.zeros(h, dtype=bool), np.zeros(h, dtype=bool)
    if h == 0:
        return weights
    for _ in range(10 * h):
        rest = point - weights @ generators
        pull = generators @ rest
        pull[used | refused] = -np.inf
        new = int(np.argmax(pull))
        if pull[new] <= _ROUNDING * scale:
            return weights
        better = _let_in(generators, point, weights, new)
        step = (better - weights) @ generators
        noise = _ROUNDING * (scale + weights.sum() + better.sum())
        if step @ (rest - 0.5 * step) > noise * np.linalg.norm(step):
            weights, used = better, better > 0
            refused[:] = False
        else:
            refused[new] = True
    raise SolverError(f"no nearest point found in the cone of {h} gradients")


def _let_in(generators: np.ndarray, point: np.ndarray, weights: np.ndarray, new: int) -> np.ndarray:
    """Return the weights after generator ``new`` was let in and those that would become negative were taken out."""
    used = weights > 0
    used[new] = True
    while True:
        wanted = np.zeros_like(weights)
        wanted[used] = np.linalg.lstsq(generators[used].T, point, rcond=_RANK)[0]
        out = used & (wanted <= 0.0)
        if not out.any():
            return wanted
        steps = np.full(len(weights), np.inf)
        steps[out] = weights[out] / np.maximum(weights[out] - wanted[out], np.finfo(float).tiny)
        weights = np.where(used, weights + steps.min() * (wanted - weights), 0.0)
        used &= steps > steps.min()


def cone_facets(generators: np.ndarray) -> np.ndarray:
    """Return F, the inward unit normals of the facets of the cone ``{x : F x >= 0}``, shape (m, r).

    Written in a basis of r of the generators, the cone is the product of one cone per group of generators that
    depend on each other: a ray or a line for a group of rank one, otherwise the facets at the origin of the convex
    hull of the group and the origin. So a pile of boxes on four corners each is as easy as one box.

    Args:
        generators: unit rows that span R^r, shape (h, r).

    Raises:
        EnumerationError: a group may have more than `MAX_FACETS` facets.
    """
    r = generators.shape[1]
    order = qr(generators.T, mode="r", pivoting=True)[1]
    basis = generators[order[:r]]
    coefficients = solve(basis.T, generators[order[r:]].T, check_finite=False)
    coefficients[np.abs(coefficients) < _ZERO] = 0.0
    together = np.abs(coefficients) @ np.abs(coefficients).T > 0
    count, group = connected_components(together, directed=False)
    normals = []
    for k in range(count):
        members = np.flatnonzero(group == k)
        dependent = coefficients[members][:, coefficients[members].any(axis=0)].T
        facets = _facets_at_origin(np.vstack([np.eye(len(members)), dependent]))
        padded = np.zeros((len(facets), r))
        padded[:, members] = facets
        normals.append(padded)
    F = solve(basis, np.vstack(normals).T, check_finite=False).T
    return F / np.linalg.norm(F, axis=1, keepdims=True)


def _facets_at_origin(points: np.ndarray) -> np.ndarray:
    """Inward normals of the cone of the points, of which the first d are the unit vectors, shape (m, d)."""
    n, d = points.shape
    if n == d:
        return np.eye(d)
    if d == 1:
        return np.ones((int(points.min() > 0), 1))
    bound = comb(n + 1 - (d + 1) // 2, n + 1 - d) + comb(n - d // 2, n + 1 - d)
    if bound > MAX_FACETS:
        raise EnumerationError(
            f"{n} contacts depend on each other with rank {d}: the cone of their gradients may have {bound} facets, "
            f"more than {MAX_FACETS}; leave out redundant contacts"
        )
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    planes = ConvexHull(np.vstack([np.zeros(d), points])).equations
    normals = -planes[np.abs(planes[:, -1]) < _ZERO, :-1]
    _, first = np.unique(np.round(normals, 9), axis=0, return_index=True)
    return normals[np.sort(first)]
