"""Routh's incremental impact of one contact with friction: impulses, energy and the end of the two phases.

The normal impulse N grows from 0 and takes the place of time. Friction is Coulomb's at every instant:
``d gamma = G (1, f) dN`` with ``f = -D^2 gamma_t / |D gamma_t|``, ``D = diag(mu)``, while the contact slides. Once it
has stopped, f is constant: it is the f in the ellipse ``|D^-1 f| <= 1`` that changes ``gamma_t`` least. That is
sticking, or sliding along a constant direction, which is the reversal of slip where there is one tangential direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

import numpy as np
import scipy

from impactlaw.errors import SolverError

Hypothesis = Literal["poisson", "stronge"]
_ROUNDING = 1e-12  # part of a sum that is left of it where its terms cancel
_STOPS = 1e-8  # part of the speed that counts as none where slip has stopped, which is found to 1e-9
_FAR = (6.0, 40.0, 1e3)  # impulse, in units of what stops the approach without friction, up to which slip is followed


class Phase(NamedTuple):
    """A stretch of N in which friction is constant: all velocities are linear in N."""

    end: float  # normal impulse at which it ends, N s
    f: np.ndarray  # friction over normal impulse, (k,)


def settled_friction(G: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Return f of a contact that has stopped sliding, (k,): ``min |gamma_t'|``, in the metric of its mass, over f."""
    A, b = G[1:, 1:] * np.outer(mu, mu), G[1:, 0] * mu
    w, V = np.linalg.eigh(A)
    w, b = np.maximum(w, 0.0), V.T @ b
    if w[0] > 1e-14 * max(w[-1], 1e-300) and np.linalg.norm(b / w) <= 1.0:
        return -mu * (V @ (b / w))
    if not b.any():
        return np.zeros(len(mu))

    def excess(multiplier: float) -> float:
        return float(np.linalg.norm(b / (w + multiplier)) - 1.0)

    high = float(np.linalg.norm(b))
    low = 1e-16 * high
    if excess(low) <= 0.0:
        return -mu * (V @ (b / (w + low)))
    multiplier = scipy.optimize.root_scalar(excess, bracket=(low, high), xtol=1e-15 * high, rtol=1e-14).root
    return -mu * (V @ (b / (w + multiplier)))


def phases_of(G: np.ndarray, slip: np.ndarray, mu: np.ndarray, approach: float) -> Iterator[Phase]:
    """Give the phases of a contact: slip until it stops, in many short ones while it turns, and what follows.

    ``dN = |gamma_t| ds`` makes the way to the stop smooth: Runge and Kutta's steps of order four in s, and friction of
    each is the mean over it. What is left once slip does not turn any more, as with one tangential direction, is one.
    The Delassus matrix G, (1 + k, 1 + k), has the normal row first; slip is ``gamma_t-``, (k,), with coefficients mu,
    (k,), and approach ``-gamma-`` of the normal, m/s.

    Raises:
        SolverError: slip does not settle, in an impact that is far beyond any without friction.
    """
    from impactlaw.laws.friction.routh_slip import sliding

    taken, stopped, speed = 0, False, float(np.abs(slip).max()) or 1.0
    for far in _FAR:
        ends, f, stopped = sliding(G, slip / speed, mu, approach / speed, far)
        yield from map(Phase, (speed * ends[taken:]).tolist(), f[taken:])
        taken = len(ends)
        if stopped:
            break
    if not stopped:
        raise SolverError(
            f"slip of a contact with friction {mu.max():g} does not settle within {taken} steps of its impact: the "
            "contact jams; take Newton's law or Poisson's"
        )
    yield Phase(np.inf, settled_friction(G, mu))


def impulses(G: np.ndarray, gamma: np.ndarray, phases: Iterable[Phase], e: float, hypothesis: Hypothesis) -> np.ndarray:
    """Return normal and tangential impulse at the end of restitution, (1 + k,).

    Where restitution ends is told with `Routh`; at the latest it is where the kinetic energy is that before. A contact
    that jams as it stops, as that of a body on a hinge can, gives nothing back: further impulse moves nothing.
    The velocities before are gamma, (1 + k,), normal first and negative; phases are those of `phases_of`.

    Raises:
        SolverError: velocities, masses or coefficients are so large that their products are no finite numbers.
    """
    speed = float(np.abs(gamma).max())
    impulse, velocity = np.zeros(len(gamma)), gamma.astype(float)
    begin = taken = energy = 0.0
    compression = np.inf
    for phase in phases:
        direction = np.concatenate([[1.0], phase.f])
        rates = _rates(G, direction)
        length = phase.end - begin
        if compression == np.inf and velocity[0] >= -speed * (_ROUNDING if rates[0] else _STOPS):
            velocity[0], compression = 0.0, begin
        if compression == np.inf and velocity[0] + rates[0] * length >= 0.0 and rates[0] > 0.0:
            part = -velocity[0] / rates[0]
            taken += 0.5 * velocity[0] * part
            energy += _work(direction, velocity, rates, part)
            impulse, velocity, begin = impulse + part * direction, velocity + part * rates, begin + part
            velocity[0], compression = 0.0, begin
            length = phase.end - begin
        if compression < np.inf and length == np.inf and not rates.any():
            rest = (1.0 + e) * compression - begin if hypothesis == "poisson" else 0.0
            return impulse + max(rest, 0.0) * direction
        if compression == np.inf:
            taken += (velocity[0] + 0.5 * rates[0] * length) * length
            energy += _work(direction, velocity, rates, length)
        else:
            if hypothesis == "poisson":
                rest = (1.0 + e) * compression - begin
            else:
                rest = _reaching(0.5 * rates[0], velocity[0], -(e * e) * taken if e else 0.0)
            rest = min(rest, _reaching(0.5 * float(direction @ rates), float(direction @ velocity), -energy))
            if velocity[0] + rates[0] * max(rest, 0.0) < 0.0:  # slip has turned so that the contact closes again
                rest = -velocity[0] / rates[0] if rates[0] > 0.0 else np.inf
            if rest <= length:
                return impulse + max(rest, 0.0) * direction
            if hypothesis != "poisson" and e:  # normal work done in restitution, in units of work taken
                taken += (velocity[0] + 0.5 * rates[0] * length) * length / (e * e)
            energy += _work(direction, velocity, rates, length)
        impulse, velocity, begin = impulse + length * direction, velocity + length * rates, phase.end
    raise SolverError(
        f"the impulse of a contact that closes at {-gamma[0]:.3g} m/s with an effective mass of {1.0 / G[0, 0]:.3g} kg "
        "is no finite number; check the units of velocities and masses"
    )


def _rates(G: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return how fast an impulse changes contact velocities, (1 + k,): 0 where that is rounding, as it jams."""
    rates = G @ direction
    rates[np.abs(rates) <= _ROUNDING * (np.abs(G) @ np.abs(direction))] = 0.0
    return rates


def _work(direction: np.ndarray, velocity: np.ndarray, rates: np.ndarray, length: float) -> float:
    return float(direction @ velocity) * length + 0.5 * float(direction @ rates) * length * length


def _reaching(a: float, b: float, c: float) -> float:
    """Return the least x >= 0 from which on ``a x^2 + b x >= c``, for c >= 0; infinite if there is none."""
    if c <= 0.0 and b >= 0.0:
        return 0.0 if (b > 0.0 or a >= 0.0) else np.inf
    root = b * b + 4.0 * a * c
    if root < 0.0:
        return np.inf
    root = np.sqrt(root)
    if a > 0.0:
        return 2.0 * c / (b + root) if b > 0.0 else (root - b) / (2.0 * a)
    return 2.0 * c / (b + root) if b > 0.0 else np.inf
