"""The Delassus matrix of contacts that few others touch, as a band, and systems with it on some of the contacts."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlaw import deferred

_MOST = 4e7
"""Largest number of stored entries of the band; a factor of that size takes some seconds."""


class BandedDelassus:
    """``G = U U^T`` for unit gradients U, in an order of the contacts in which it is a band of least width.

    Attributes:
        gradients: U in that order, CSR, (h, nv).
        order: contact at each place of the band, (h,).
        band: ``G[j + k, j]`` at ``[k, j]``, (width + 1, h).
        largest: a bound of the largest eigenvalue of G.
    """

    def __init__(self, gradients: Any):
        G = (gradients @ gradients.T).tocoo()
        h = gradients.shape[0]
        self.largest = float(np.bincount(G.row, weights=np.abs(G.data), minlength=h).max())
        self.order = np.arange(h)
        width = int(np.abs(G.row - G.col).max(initial=0))
        if width > 1:
            order = deferred.reverse_cuthill_mckee(G.tocsr(), symmetric_mode=True).astype(int)
            place = np.empty(h, dtype=int)
            place[order] = np.arange(h)
            better = int(np.abs(place[G.row] - place[G.col]).max(initial=0))
            if better < width:
                self.order, width = order, better
                G.row, G.col = place[G.row], place[G.col]
                gradients = gradients[order]
        self.gradients, self._transposed = gradients, gradients.T.tocsr()
        self.band = np.zeros((0, h))
        if (width + 1) * h <= _MOST:
            lower = G.row >= G.col
            self.band = np.zeros((width + 1, h), order="F")
            self.band[G.row[lower] - G.col[lower], G.col[lower]] = G.data[lower]

    def jump(self, impulse: np.ndarray) -> np.ndarray:
        """Return ``U^T Lambda``, (nv,)."""
        return self._transposed.dot(impulse)

    def factor(self, active: np.ndarray, shift: float) -> Factor | None:
        """Return the factor of ``G + shift 1`` on the active contacts; None where it is singular to rounding."""
        band = self.band.copy(order="F")
        band[0] += shift
        if not active.all():
            weight = active.astype(float)
            for k in range(1, len(band)):
                band[k, : len(weight) - k] *= weight[k:] * weight[: len(weight) - k]
            band[0, ~active] = 1.0
        return Factor.of(band, active)


class Factor:
    """A Cholesky factor of a band; rows of inactive contacts are those of the unit matrix."""

    def __init__(self, parts: tuple[np.ndarray, ...], active: np.ndarray):
        self._parts, self._active = parts, active

    @classmethod
    def of(cls, band: np.ndarray, active: np.ndarray) -> Factor | None:
        """Factor; None where a pivot is not positive."""
        if len(band) == 1:
            return cls((band[0],), active) if band[0].min(initial=1.0) > 0 else None
        if len(band) == 2:
            diagonal, below, failed = deferred.dpttrf(band[0], band[1, :-1])
            return None if failed else cls((diagonal, below), active)
        factor, failed = deferred.dpbtrf(band, lower=1, overwrite_ab=1)
        return None if failed else cls((factor,), active)

    @property
    def least_pivot(self) -> float:
        """Least squared sine of the angle between a unit gradient and the span of those before it."""
        pivots = self._parts[0] if self._parts[0].ndim == 1 else self._parts[0][0] ** 2
        return float(pivots.min(initial=1.0))

    def solve(self, wanted: np.ndarray) -> np.ndarray:
        """Return the solution, (h,), zero on inactive contacts."""
        wanted = np.where(self._active, wanted, 0.0)
        parts = self._parts
        if len(parts) == 2:
            return deferred.dpttrs(*parts, wanted)[0]
        if parts[0].ndim == 1:
            return wanted / parts[0]
        return deferred.dpbtrs(parts[0], wanted, lower=1)[0]
