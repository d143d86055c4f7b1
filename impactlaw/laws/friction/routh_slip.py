"""Compiled integration of slip that turns during an impact.

It is all in this one file, so that numba's cache on disk is renewed whenever it changes.
"""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled

_FINE = 0.1  # first step in units of the fastest rate of slip
_SHARE = 0.05  # largest normal impulse of a step, relative to the one that stops the approach without friction
_TOLERANCE = 1e-10  # allowed error of a step, relative to the slip before the impact
_RELATIVE = 1e-8  # further allowed error of a step, relative to the current slip
_STRAIGHT = 1e-10  # turning rate of slip, relative to the fastest rate, that counts as 0: one step does the rest
_STOPPED = 1e-9  # slip, relative to the slip before the impact, that counts as 0
_MOST = 20_000
_PLACES = 8  # Newton iterations for the length ds of a step with a given normal impulse


@compiled()
def _friction(slip, mu):
    """Return ``D^2 u / |D u|`` for slip u, (k,)."""
    size = 0.0
    for i in range(len(mu)):
        size += (mu[i] * slip[i]) ** 2
    return mu * mu * slip / np.sqrt(size)


@compiled()
def _stepped(Gn, Gt, mu, slip, ds):
    """Return slip, normal impulse N, friction impulse T and ``int T dN`` after a Runge-Kutta step of order four."""
    u, done, impulse, change = slip, 0.0, np.zeros(len(mu)), np.zeros(len(mu))
    so_far, moment = np.zeros(len(mu)), np.zeros(len(mu))
    for stage in range(4):
        size = np.sqrt((u * u).sum())
        f = -size * _friction(u, mu) if size > 0.0 else np.zeros(len(mu))
        rate = size * Gn + Gt @ f
        weight = ds / 6.0 if stage == 0 or stage == 3 else ds / 3.0
        done += weight * size
        impulse += weight * f
        moment += weight * size * so_far
        change += weight * rate
        ahead = ds if stage == 2 else 0.5 * ds
        u, so_far = slip + ahead * rate, ahead * f
    return slip + change, done, impulse, moment


@compiled()
def part_of(G, mu, slip, ds, length):
    """Return the part of the step ds whose normal impulse is ``length``, and what `_stepped` returns for it."""
    Gt, Gn = np.ascontiguousarray(G[1:, 1:]), np.ascontiguousarray(G[1:, 0])
    whole = _stepped(Gn, Gt, mu, slip, ds)
    if length >= whole[1]:
        return ds, whole[0], whole[1], whole[2], whole[3]
    part = ds * length / whole[1]
    for _ in range(_PLACES):
        after, done, _, _ = _stepped(Gn, Gt, mu, slip, part)
        speed = max(np.sqrt((after * after).sum()), 1e-300)
        part = min(max(part - (done - length) / speed, 0.1 * part), 0.5 * (part + ds))
    after, done, impulse, moment = _stepped(Gn, Gt, mu, slip, part)
    return part, after, done, impulse, moment


@compiled()
def sliding(G, slip, mu, approach, far):
    """Return steps, (m, 2 + 3 k), and whether slip has stopped after them.

    A row has the normal impulse at the end of the step, its length ds, the slip before it, the mean friction impulse
    over normal impulse, and ``int T dN`` less its value for this mean. The integration ends when slip has stopped, or
    when the normal impulse is ``far`` times the one that stops the approach without friction. A last step with ds = 0
    is the rest of a slip that keeps its direction.
    """
    k = len(mu)
    Gt, Gn = np.ascontiguousarray(G[1:, 1:]), np.ascontiguousarray(G[1:, 0])
    fastest = np.sqrt((Gt * Gt).sum()) * mu.max() + np.sqrt((Gn * Gn).sum())
    steps = np.empty((_MOST, 2 + 3 * k))
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
            steps[count] = 0.0
            steps[count, 0] = at - size / along if along < 0.0 else np.inf
            steps[count, 2 : 2 + k], steps[count, 2 + k : 2 + 2 * k] = slip, f / size
            return steps[: count + 1], True
        while True:
            ds = min(next_ds, _SHARE * approach / (G[0, 0] * size))
            whole, _, _, _ = _stepped(Gn, Gt, mu, slip, ds)
            half = _stepped(Gn, Gt, mu, slip, 0.5 * ds)
            rest = _stepped(Gn, Gt, mu, half[0], 0.5 * ds)
            end = rest[0]
            error = np.sqrt(((whole - end) ** 2).sum()) / (_TOLERANCE * first + _RELATIVE * size)
            next_ds = ds * min(4.0, max(0.2, 0.9 * (error + 1e-30) ** -0.2))
            if not error > 1.0:
                break
        for taken in (half, rest):
            after, done, impulse, moment = taken
            at += done
            steps[count, 0], steps[count, 1], steps[count, 2 : 2 + k] = at, 0.5 * ds, slip
            steps[count, 2 + k : 2 + 2 * k] = impulse / done
            steps[count, 2 + 2 * k :] = moment - 0.5 * done * impulse
            slip = after
            count += 1
    return steps[:count], stopped
