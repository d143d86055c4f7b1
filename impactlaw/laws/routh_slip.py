"""Slip that turns during an impact, compiled; in one file, so that numba's cache is renewed when it changes."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled

_FINE = 0.1  # step in units of the fastest rate of slip
_SHARE = 0.02  # of the impulse that stops the approach without friction, for one step
_STRAIGHT = 1e-10  # turn of slip, relative to the fastest rate, that counts as none: the rest is one step
_STOPPED = 1e-9  # slip, relative to that before, that counts as none
_MOST = 20_000


@compiled()
def _friction(slip, mu):
    """Return ``D^2 u / |D u|`` of the direction u of slip, (k,)."""
    size = 0.0
    for i in range(len(mu)):
        size += (mu[i] * slip[i]) ** 2
    return mu * mu * slip / np.sqrt(size)


@compiled()
def sliding(G, slip, mu, approach, far):
    """Return the ends of steps in normal impulse, (m,), and the mean friction over normal impulse in each, (m, k).

    They go on until slip has stopped, or normal impulse is ``far`` times what stops the approach without friction. The
    third value is whether slip has stopped.
    """
    k = len(mu)
    Gt, Gn = np.ascontiguousarray(G[1:, 1:]), np.ascontiguousarray(G[1:, 0])
    fastest = np.sqrt((Gt * Gt).sum()) * mu.max() + np.sqrt((Gn * Gn).sum())
    ends, means = np.empty(_MOST), np.empty((_MOST, k))
    slip, first = slip.copy(), np.sqrt((slip * slip).sum())
    at, count = 0.0, 0
    stopped = False
    while count < _MOST - 1 and at < far * approach / G[0, 0]:
        size = np.sqrt((slip * slip).sum())
        stopped = size <= _STOPPED * first
        if stopped:
            break
        f = -size * _friction(slip, mu)
        rate = size * Gn + Gt @ f
        along = (rate * slip).sum() / size**2
        if np.sqrt(((rate - along * slip) ** 2).sum()) <= _STRAIGHT * fastest * size:
            at, stopped = (at - size / along, True) if along < 0.0 else (np.inf, True)
            ends[count], means[count] = at, f / size
            count += 1
            break
        ds = min(_FINE / fastest, _SHARE * approach / (G[0, 0] * size))
        u, done, impulse = slip.copy(), 0.0, np.zeros(k)
        change = np.zeros(k)
        for stage in range(4):
            size = np.sqrt((u * u).sum())
            f = -size * _friction(u, mu) if size > 0.0 else np.zeros(k)
            rate = size * Gn + Gt @ f
            weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
            done += weight * ds * size
            impulse += weight * ds * f
            change += weight * ds * rate
            u = slip + (ds if stage == 2 else 0.5 * ds) * rate
        slip += change
        at += done
        ends[count], means[count] = at, impulse / done
        count += 1
    return ends[:count], means[:count], stopped or first == 0.0
