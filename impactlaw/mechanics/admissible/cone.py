"""The facets of the cone of the gap gradients, ``{Y^T Lambda : Lambda >= 0}``."""

from __future__ import annotations

from math import comb

import numpy as np
import scipy

from impactlaw.errors import ImpactLawError
from impactlaw.mechanics.tolerances import ON_FACET

MAX_FACETS = 20_000
"""Groups of dependent gradients that may have more facets, by the upper bound theorem, are refused."""


class EnumerationError(ImpactLawError):
    """A set has too many faces to list: too many redundant gradients of too high a rank."""


def cone_facets(generators: np.ndarray) -> np.ndarray:
    """Return the inward unit normals F, (m, r), of the facets of the cone ``{x : F x >= 0}`` of unit rows, (h, r).

    In a basis of r of the generators, the cone is a product of cones, one for each group of generators that depend
    on each other. The cone of a group of rank one is a ray or a line. Otherwise its facets are those, at the origin, of
    the convex hull of the group and the origin. So a pile of boxes, each on four corners, is as easy as one box.

    Raises:
        EnumerationError: a group may have more than `MAX_FACETS` facets.
    """
    r = generators.shape[1]
    if len(generators) == r:
        F = scipy.linalg.inv(generators.T, check_finite=False)
        return F / np.linalg.norm(F, axis=1, keepdims=True)
    *_, order = scipy.linalg.qr(generators.T, mode="r", pivoting=True)
    basis = generators[order[:r]]
    coefficients = scipy.linalg.solve(basis.T, generators[order[r:]].T, check_finite=False)
    coefficients[np.abs(coefficients) < ON_FACET] = 0.0
    together = np.abs(coefficients) @ np.abs(coefficients).T > 0
    count, group = scipy.sparse.csgraph.connected_components(together, directed=False)
    normals = []
    for k in range(count):
        members = np.flatnonzero(group == k)
        dependent = coefficients[members][:, coefficients[members].any(axis=0)].T
        facets = _facets_at_origin(np.vstack([np.eye(len(members)), dependent]))
        padded = np.zeros((len(facets), r))
        padded[:, members] = facets
        normals.append(padded)
    F = scipy.linalg.solve(basis, np.vstack(normals).T, check_finite=False).T
    return F / np.linalg.norm(F, axis=1, keepdims=True)


def _facets_at_origin(points: np.ndarray) -> np.ndarray:
    """Return inward normals, (m, d), of the cone of points, (n, d), the first d of which are the unit vectors."""
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
    planes = scipy.spatial.ConvexHull(np.vstack([np.zeros(d), points])).equations
    normals = -planes[np.abs(planes[:, -1]) < ON_FACET, :-1]
    _, first = np.unique(np.round(normals, 9), axis=0, return_index=True)
    return normals[np.sort(first)]
