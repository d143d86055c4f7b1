"""Compiled time integration of a collision whose contacts are springs ``f = k d^p``.

All compiled functions are in this one file, so that numba's cache on disk is renewed whenever it changes.
"""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled

# Blanes and Moan (J. Comput. Appl. Math. 142, 2002): symmetric splitting of order four in six stages
_A1, _A2, _A3 = 0.0792036964311957, 0.353172906049774, -0.0420650803577195
_B1, _B2 = 0.209515106613362, -0.143851773179818
_DRIFT = (_A1, _A2, _A3, 1.0 - 2.0 * (_A1 + _A2 + _A3), _A3, _A2, _A1)
_KICK = (_B1, _B2, 0.5 - _B1 - _B2, 0.5 - _B1 - _B2, _B2, _B1)
_GRADED = 0.3  # step after a contact with a fractional exponent has closed, relative to the time since it closed
_SHORTEST = 2e-3  # least step near such a contact, relative to the usual step
_FELT = 1e-5  # impulse of a step, relative to the total, from which shorter steps are needed there
_ROUNDING = 1e-13  # rounding of speeds and lengths, relative to the largest ones
_NEAR = 1e-12  # tolerance of event location, relative to the step
_LOCATED = 80  # most iterations of the location of an event
MOST_STEPS = 1_000_000
"""Most time steps of a collision; one that has not ended by then is given up."""


@compiled()
def _force(d, reached, k, p, plastic, force):
    """Write the forces of springs compressed by d, (h,), whose largest compression so far is ``reached``, (h,)."""
    for i in range(len(d)):
        x, r = d[i], reached[i]
        rest = plastic * r
        if x <= rest:
            force[i] = 0.0
            continue
        if x < r:  # unloading, or loading again
            x = r * (x - rest) / (r - rest)
        if p == 1.0:
            force[i] = k[i] * x
        elif p == 1.5:
            force[i] = k[i] * x * np.sqrt(x)
        else:
            force[i] = k[i] * x**p


@compiled()
def _advance(d, y, impulse, reached, G, k, p, plastic, h, force):
    """Advance compressions d, contact velocities y and impulses, (n,) each, by the time h."""
    n = len(d)
    for stage in range(7):
        for i in range(n):
            d[i] -= _DRIFT[stage] * h * y[i]
        if stage == 6:
            break
        _force(d, reached, k, p, plastic, force)
        for j in range(n):
            if force[j] != 0.0:
                kick = _KICK[stage] * h * force[j]
                impulse[j] += kick
                for i in range(n):
                    y[i] += G[i, j] * kick


@compiled()
def _passed(d, y, d0, y0, reached, plastic):
    """Return how far a step has gone beyond its first event, as a fraction of the step; 0 if it has no event.

    Events are a contact that closes or opens, one that begins to unload at a new largest compression, and one that is
    loaded again beyond its largest compression. With elastic springs only the first kind matters.
    """
    most = 0.0
    for i in range(len(d)):
        rest = plastic * reached[i]
        before, after = d0[i] - rest, d[i] - rest
        if before * after < 0.0 and abs(before) > _ROUNDING:
            most = max(most, after / (after - before))
        if plastic > 0.0:
            if y0[i] < -_ROUNDING and y[i] > 0.0 and d0[i] >= reached[i] - _ROUNDING:
                most = max(most, y[i] / (y[i] - y0[i]))
            before, after = d0[i] - reached[i], d[i] - reached[i]
            if before < -_ROUNDING and after > 0.0 and y0[i] < 0.0:
                most = max(most, after / (after - before))
    return most


@compiled()
def _bounded(G, stiffness, step):
    """Return ``step`` over a bound on the largest frequency for these stiffnesses; infinite if all are 0."""
    fastest = 0.0
    for i in range(len(stiffness)):
        row = 0.0
        for j in range(len(stiffness)):
            row += abs(G[i, j]) * np.sqrt(stiffness[i] * stiffness[j])
        fastest = max(fastest, row)
    return step / np.sqrt(fastest) if fastest > 0.0 else np.inf


@compiled()
def _timestep(d, y, reached, deepest, G, k, p, plastic, step):
    """Return the time step for the contacts that are closed and those that will close within it."""
    n = len(d)
    stiffness, closed = np.zeros(n), np.zeros(n)
    for i in range(n):
        depth = d[i] - plastic * reached[i]
        stiffness[i] = p * k[i] * deepest[i] ** (p - 1.0)
        if reached[i] > 0.0 and (d[i] < reached[i] or y[i] > 0.0):
            stiffness[i] = p * k[i] * reached[i] ** (p - 1.0) / (1.0 - plastic)
        if depth > 0.0 or (depth >= -_ROUNDING and y[i] <= 0.0):
            closed[i] = stiffness[i]
    usual = h = _bounded(G, closed, step)
    for i in range(n):
        gap = plastic * reached[i] - d[i]
        if closed[i] == 0.0 and y[i] < 0.0 and gap < -2.0 * usual * y[i]:
            closed[i] = stiffness[i]
            h = min(h, max(_bounded(G, closed, step), 0.5 * gap / -y[i]))
            closed[i] = 0.0
    if p != np.floor(p):
        usual, fine = h, 10.0 * step
        for i in range(n):
            depth = d[i] - plastic * reached[i]
            if closed[i] > 0.0 and y[i] != 0.0:
                coming = usual * closed[i] * (depth + usual * abs(y[i]))
                if coming > _FELT * fine**4:
                    h = min(h, max(_SHORTEST * fine * usual, _GRADED * fine * depth / abs(y[i])))
    return h


@compiled()
def _flight(d, y, reached, plastic):
    """Return the time until the first of all open contacts closes, infinite if none will; -1 if one is closed now."""
    time = np.inf
    for i in range(len(d)):
        gap = plastic * reached[i] - d[i]
        if gap < -_ROUNDING:
            return -1.0
        if y[i] < -_ROUNDING:
            if gap <= _ROUNDING:
                return -1.0
            time = min(time, gap / -y[i])
    return time


@compiled()
def _collide(G, y, k, p, plastic, deepest, step):
    """Return the impulses of one collision, (n,), and the number of steps; see `spring_impulses`."""
    n = len(y)
    y = y.copy()
    d, reached, impulse, force = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    d1, y1, impulse1 = np.zeros(n), np.zeros(n), np.zeros(n)
    steps = 0
    while steps < MOST_STEPS:
        time = _flight(d, y, reached, plastic)
        if time == np.inf:
            return impulse, steps
        if time > 0.0:
            for i in range(n):
                d[i] -= time * y[i]
                if abs(d[i] - plastic * reached[i]) <= 1e-12 * (1.0 + time):
                    d[i] = plastic * reached[i]
        h = _timestep(d, y, reached, deepest, G, k, p, plastic, step)
        low, high, trial = 0.0, h, h
        for attempt in range(_LOCATED):
            d1[:], y1[:], impulse1[:] = d, y, impulse
            _advance(d1, y1, impulse1, reached, G, k, p, plastic, trial, force)
            steps += 1
            beyond = _passed(d1, y1, d, y, reached, plastic)
            if attempt == 0 and beyond == 0.0:
                break
            if beyond > 0.0:
                high = trial
            else:
                low = trial
            if 0.0 < beyond * trial <= _NEAR * h or high - low <= _NEAR * h:
                break
            share = trial * (1.0 - 0.999 * beyond)
            trial = share if beyond > 0.0 and low < share and attempt % 4 != 3 else 0.5 * (low + high)
        d[:], y[:], impulse[:] = d1, y1, impulse1
        for i in range(n):
            if plastic > 0.0:
                reached[i] = max(reached[i], d[i])
            if abs(d[i] - plastic * reached[i]) <= 1e-13 * h and not (reached[i] > 0.0 and plastic == 1.0):
                d[i] = plastic * reached[i]
    return impulse, -1


@compiled()
def spring_impulses(G, velocities, stiffness, exponent, plastic, deepest, step):
    """Return the impulses, (m, n), of collisions with ``f = k d^p``, and their numbers of steps, (m,); -1 if too many.

    All contacts start at d = 0 with ``velocities``, (m, n); ``d' = -gamma`` and ``gamma' = G f``. A spring that was
    compressed by r keeps a part of it: while it unloads its force ends at ``d = plastic r``.

    Args:
        G: Delassus matrix, (n, n), with ones on its diagonal.
        velocities: ``gamma-``, of order one.
        stiffness: k, (n,).
        exponent: p of at least 1.
        plastic: ``1 - e^2``.
        deepest: bounds on d, (m, n).
        step: time step times the largest frequency.
    """
    m, n = velocities.shape
    impulses, steps = np.zeros((m, n)), np.zeros(m, np.int64)
    for a in range(m):
        impulses[a], steps[a] = _collide(G, velocities[a], stiffness, exponent, plastic, deepest[a], step)
    return impulses, steps
