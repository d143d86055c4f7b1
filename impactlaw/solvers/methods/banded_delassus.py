"""The Delassus matrix as a band, for contacts coupled with few others, and its factors on active contacts."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from impactlaw.solvers.problem import Problem

_MOST = 4e7  # largest number of stored entries of the band; a factor of that size takes some seconds


class BandedDelassus:
    """``G = U U^T`` for the unit gradients U of a problem, in an order of the contacts that makes the band narrow.

    Attributes:
        order: contact at each position of the band, (h,).
        band: ``G[j + k, j]`` at ``[k, j]``, (width + 1, h); without rows if it would be too large.
    """

    def __init__(self, problem: Problem):
        U = scipy.sparse.csr_array(problem.unit[0])
        h = U.shape[0]
        G = self._delassus = U @ U.T
        self.order = np.arange(h)
        entries = G.tocoo()
        row, column = entries.row, entries.col
        width = int(np.abs(row - column).max(initial=0))
        if width > 1:
            order = scipy.sparse.csgraph.reverse_cuthill_mckee(G, symmetric_mode=True)
            place = np.argsort(order)
            narrower = int(np.abs(place[row] - place[column]).max())
            if narrower < width:
                self.order, width, row, column, U = order, narrower, place[row], place[column], U[order]
        self._gradients, self._transposed = U, U.T
        self.band = np.zeros((0, h))
        if (width + 1) * h <= _MOST:
            self.band = np.zeros((width + 1, h))
            lower = row >= column
            self.band[(row - column)[lower], column[lower]] = entries.data[lower]

    @cached_property
    def largest(self) -> float:
        """An upper bound of the largest eigenvalue of G: the largest sum of a row's magnitudes."""
        return float(abs(self._delassus).sum(axis=1).max())

    def product(self, impulse: np.ndarray) -> np.ndarray:
        """Return ``U (U^T Lambda)``, (h,), without the rounding errors of G."""
        return self._gradients @ (self._transposed @ impulse)

    def factor(self, active: np.ndarray, shift: float) -> Factor | None:
        """Return the factor of ``G + shift 1`` on the active contacts; None if it is numerically singular."""
        band = self.band.copy()
        band[0] += shift
        if not active.all():
            for k in range(1, len(band)):
                band[k, :-k] *= active[k:] & active[:-k]
        factor, failed = scipy.linalg.lapack.dpbtrf(band, lower=1)
        return None if failed else Factor(factor, active)


class Factor:
    """A Cholesky factor of a band in which inactive contacts are uncoupled.

    Attributes:
        least_pivot: least squared sine of the angle between a unit gradient and the span of the gradients before it.
    """

    def __init__(self, factor: np.ndarray, active: np.ndarray):
        self._factor, self._active = factor, active
        self.least_pivot = float(factor[0].min()) ** 2

    def solve(self, wanted: np.ndarray) -> np.ndarray:
        """Return the solution, (h,), zero on inactive contacts."""
        return scipy.linalg.lapack.dpbtrs(self._factor, wanted * self._active, lower=1)[0]
