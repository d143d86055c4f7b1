"""The cone of the gap gradients, ``{Y^T Lambda : Lambda >= 0}``: nearest points and facets."""

from __future__ import annotations

from math import comb

import numpy as np

from impactlaw import deferred
from impactlaw.errors import ImpactLawError, SolverError

MAX_FACETS = 20_000
"""Most facets that a group of dependent gradients may have (upper bound theorem) before they are not listed."""
RANK = 1e-10
"""Relative singular value below which gradients of unit length count as dependent; rounding over this is 1e-6."""
_ZERO = 1e-11  # coefficient of unit gradients, or offset of a facet, that counts as rounding
_ROUNDING = 4e-15  # pull on a generator, relative to the point, that counts as zero


class EnumerationError(ImpactLawError):
    """A set has too many faces to list them: too many redundant gradients of too high a rank."""


def nearest_in_cone(generators: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return ``Lambda >= 0`` that minimises ``|Y^T Lambda - point|``, shape (h,), for unit rows Y.

    Lawson and Hanson's active set: let in the generator that the remainder pulls on most, then take out those that
    would become negative. `scipy.optimize.nnls` is the same method in C, but up to scipy 1.17 it can return a wrong
    answer where a generator depends on those that are in, as opposing contacts do
    (https://github.com/scipy/scipy/pull/26180); so it only gives the start.

    Raises:
        SolverError: not finished after ten changes per generator.
    """
    h, enough = len(generators), _ROUNDING * float(np.linalg.norm(point))
    if h == 0:
        return np.zeros(0)
    try:
        start = deferred.nnls(generators.T, point)[0]
    except RuntimeError:  # not finished
        start = np.zeros(h)
    weights, rest = _without_negative(generators, point, start, start > 0)
    seen, refused = {(weights > 0).tobytes()}, np.zeros(h, dtype=bool)
    for _ in range(10 * h + 1):
        pull = np.where((weights > 0) | refused, -np.inf, generators @ rest)
        new = int(np.argmax(pull))
        if pull[new] <= enough:
            return weights
        used = weights > 0
        used[new] = True
        better, remainder = _without_negative(generators, point, weights, used)
        key = (better > 0).tobytes()
        if key in seen:  # only rounding leads back to contacts that were in together before
            refused[new] = True
            continue
        seen.add(key)
        refused[:] = False
        weights, rest = better, remainder
    raise SolverError(f"no nearest point found in the cone of {h} gradients")


def _without_negative(
    generators: np.ndarray, point: np.ndarray, weights: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the used generators, taking out those that would become negative; return the weights and what they leave."""
    while True:
        V, s, U = np.linalg.svd(generators[used].T, full_matrices=False)
        keep = s > RANK * s.max(initial=0.0)
        V, wanted = V[:, keep], np.zeros_like(weights)
        wanted[used] = ((point @ V) / s[keep]) @ U[keep]
        out = used & (wanted <= 0.0)
        if not out.any():
            rest = point - V @ (V.T @ point)
            return wanted, rest - V @ (V.T @ rest)
        steps = np.full(len(weights), np.inf)
        steps[out] = weights[out] / np.maximum(weights[out] - wanted[out], np.finfo(float).tiny)
        weights = np.where(used, weights + steps.min() * (wanted - weights), 0.0)
        used = used & (steps > steps.min())


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
    *_, order = deferred.qr(generators.T, mode="r", pivoting=True)
    basis = generators[order[:r]]
    coefficients = deferred.solve(basis.T, generators[order[r:]].T, check_finite=False)
    coefficients[np.abs(coefficients) < _ZERO] = 0.0
    together = np.abs(coefficients) @ np.abs(coefficients).T > 0
    count, group = deferred.connected_components(together, directed=False)
    normals = []
    for k in range(count):
        members = np.flatnonzero(group == k)
        dependent = coefficients[members][:, coefficients[members].any(axis=0)].T
        facets = _facets_at_origin(np.vstack([np.eye(len(members)), dependent]))
        padded = np.zeros((len(facets), r))
        padded[:, members] = facets
        normals.append(padded)
    F = deferred.solve(basis, np.vstack(normals).T, check_finite=False).T
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
    planes = deferred.ConvexHull(np.vstack([np.zeros(d), points])).equations
    normals = -planes[np.abs(planes[:, -1]) < _ZERO, :-1]
    _, first = np.unique(np.round(normals, 9), axis=0, return_index=True)
    return normals[np.sort(first)]
