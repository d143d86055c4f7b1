"""Slip that turns during an impact, compiled; in one file, so that numba's cache is renewed when it changes."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled

_FINE = 0.1  # first step in units of the fastest rate of slip
_SHARE = 0.05  # of the impulse that stops the approach without friction, for one step
_TOLERANCE = 1e-10  # error of a step, relative to the slip before
_RELATIVE = 1e-8  # the same, relative to the slip of now
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
def _stepped(Gn, Gt, mu, slip, ds):
    """Return slip, normal impulse and friction impulse after Runge and Kutta's step of order four."""
    u, done, impulse, change = slip, 0.0, np.zeros(len(mu)), np.zeros(len(mu))
    for stage in range(4):
        size = np.sqrt((u * u).sum())
        f = -size * _friction(u, mu) if size > 0.0 else np.zeros(len(mu))
        rate = size * Gn + Gt @ f
        weight = ds / 6.0 if stage == 0 or stage == 3 else ds / 3.0
        done += weight * size
        impulse += weight * f
        change += weight * rate
        u = slip + (ds if stage == 2 else 0.5 * ds) * rate
    return slip + change, done, impulse


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
    at, count, stopped, next_ds = 0.0, 0, first == 0.0, _FINE / fastest
    while count < _MOST - 2 and at < far * approach / G[0, 0] and not stopped:
        size = np.sqrt((slip * slip).sum())
        stopped = size <= _STOPPED * first
        if stopped:
            break
        f = -size * _friction(slip, mu)
        rate = size * Gn + Gt @ f
        along = (rate * slip).sum() / size**2
        if np.sqrt(((rate - along * slip) ** 2).sum()) <= _STRAIGHT * fastest * size:
            ends[count], means[count] = at - size / along if along < 0.0 else np.inf, f / size
            return ends[: count + 1], means[: count + 1], True
        while True:
            ds = min(next_ds, _SHARE * approach / (G[0, 0] * size))
            whole, _, _ = _stepped(Gn, Gt, mu, slip, ds)
            middle, done1, impulse1 = _stepped(Gn, Gt, mu, slip, 0.5 * ds)
            end, done2, impulse2 = _stepped(Gn, Gt, mu, middle, 0.5 * ds)
            error = np.sqrt(((whole - end) ** 2).sum()) / (_TOLERANCE * first + _RELATIVE * size)
            next_ds = ds * min(4.0, max(0.2, 0.9 * (error + 1e-30) ** -0.2))
            if not error > 1.0:
                break
        slip = end
        ends[count], means[count] = at + done1, impulse1 / done1
        at += done1 + done2
        ends[count + 1], means[count + 1] = at, impulse2 / done2
        count += 2
    return ends[:count], means[:count], stopped
