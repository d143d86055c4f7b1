"""The Delassus matrix of contacts that few others touch, as a band, and systems with it on some of the contacts."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.problem import Problem, row_numbers, sparse

_MOST = 4e7
"""Largest number of stored entries of the band; a factor of that size takes some seconds."""
_TOUCHING = 8  # contacts on one degree of freedom up to which pairs of them are found faster than by a matrix product
_NARROW = 2  # width of a band up to which a product with it is faster than one with Y and one with Y^T


class BandedDelassus:
    """``G = U U^T`` for the unit gradients U of a problem, in an order of the contacts that makes the band narrow.

    Attributes:
        order: contact at each place of the band, (h,).
        band: ``G[j + k, j]`` at ``[k, j]``, (width + 1, h); no rows where it would be too large.
    """

    def __init__(self, problem: Problem):
        Y, lengths = sparse(problem.gradients), problem.lengths
        transposed = problem.transposed if problem.is_sparse else Y.T
        h = len(lengths)
        diagonal, low, high, values = _products(Y, lengths)
        self.order = np.arange(h)
        width = int((high - low).max(initial=0))
        if width > 1:
            graph = deferred.csr_array((np.ones(2 * len(low)), (np.r_[low, high], np.r_[high, low])), shape=(h, h))
            order = deferred.reverse_cuthill_mckee(graph, symmetric_mode=True).astype(int)
            place = np.empty(h, dtype=int)
            place[order] = np.arange(h)
            one, other = place[low], place[high]
            better = int(np.abs(other - one).max())
            if better < width:
                self.order, width = order, better
                low, high = np.minimum(one, other), np.maximum(one, other)
                Y, lengths, diagonal = Y[order], lengths[order], diagonal[order]
                transposed = Y.T
        self._gradients, self._transposed, self._lengths = Y, transposed, lengths
        self.band = np.zeros((0, h))
        if (width + 1) * h <= _MOST:
            self.band = np.zeros((width + 1, h))
            if width > 0:
                entries = np.bincount((high - low) * h + low, weights=values, minlength=self.band.size)
                self.band = entries.reshape(self.band.shape)
            self.band[0] = diagonal

    @cached_property
    def largest(self) -> float:
        """A bound of the largest eigenvalue of G: the largest sum of a row's magnitudes."""
        sums = np.abs(self.band[0])
        for k, row in enumerate(np.abs(self.band[1:]), 1):
            sums[:-k] += row[:-k]
            sums[k:] += row[:-k]
        return float(sums.max())

    def product(self, impulse: np.ndarray) -> np.ndarray:
        """Return ``G Lambda``, (h,), the faster way."""
        band = self.band
        if len(band) > _NARROW + 1:
            return self.careful_product(impulse)
        result = band[0] * impulse
        for k in range(1, len(band)):
            result[k:] += band[k, :-k] * impulse[:-k]
            result[:-k] += band[k, :-k] * impulse[k:]
        return result

    def careful_product(self, impulse: np.ndarray) -> np.ndarray:
        """Return ``U (U^T Lambda)``, (h,), without the rounding of G."""
        return self._gradients.dot(self._transposed.dot(impulse / self._lengths)) / self._lengths

    def factor(self, active: np.ndarray, shift: float) -> Factor | None:
        """Return the factor of ``G + shift 1`` on the active contacts; None where it is singular to rounding."""
        band, partly = self.band, not active.all()
        diagonal = band[0] + shift
        if len(band) == 1:
            return Factor((diagonal,), active, float(diagonal.min()))
        if len(band) == 2:
            below = band[1, :-1] * (active[1:] & active[:-1]) if partly else band[1, :-1]
            pivots, below, failed = deferred.dpttrf(diagonal, below)
            return None if failed else Factor((pivots, below), active, float(pivots.min()))
        band = band.copy(order="F")
        band[0] = diagonal
        if partly:
            weight = active.astype(float)
            for k in range(1, len(band)):
                band[k, :-k] *= weight[k:] * weight[:-k]
        factor, failed = deferred.dpbtrf(band, lower=1, overwrite_ab=1)
        return None if failed else Factor((factor,), active, float(factor[0].min()) ** 2)


class Factor:
    """A Cholesky factor of a band in which inactive contacts are coupled with none.

    Attributes:
        least_pivot: least squared sine of the angle between a unit gradient and the span of those before it.
    """

    def __init__(self, parts: tuple[np.ndarray, ...], active: np.ndarray, least_pivot: float):
        self._parts, self._active, self.least_pivot = parts, active, least_pivot

    def solve(self, wanted: np.ndarray) -> np.ndarray:
        """Return the solution, (h,), zero on inactive contacts."""
        wanted = wanted * self._active
        parts = self._parts
        if len(parts) == 2:
            return deferred.dpttrs(*parts, wanted)[0]
        if parts[0].ndim == 1:
            return wanted / parts[0]
        return deferred.dpbtrs(parts[0], wanted, lower=1)[0]


def _products(Y: Any, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the diagonal of G, (h,), and i, j and value of what is above it; values at the same place add up."""
    rows = row_numbers(Y)
    data = Y.data / lengths[rows]
    diagonal = np.bincount(rows, weights=data * data, minlength=len(lengths))
    touching = int(np.bincount(Y.indices).max(initial=0))
    if touching > _TOUCHING:
        G = (Y @ Y.T).tocoo()
        above = G.row < G.col
        i, j = G.row[above], G.col[above]
        return diagonal, i, j, G.data[above] / (lengths[i] * lengths[j])
    order = np.argsort(Y.indices, kind="stable")
    column, rows, data = Y.indices[order], rows[order], data[order]
    found = [(rows[:0], rows[:0], data[:0])]
    for k in range(1, touching):
        at = np.flatnonzero(column[k:] == column[:-k])
        found.append((rows[at], rows[at + k], data[at] * data[at + k]))
    i, j, values = found[-1] if len(found) <= 2 else map(np.concatenate, zip(*found, strict=True))
    return diagonal, i, j, values
