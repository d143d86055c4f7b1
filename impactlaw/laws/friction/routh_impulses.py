"""Routh's incremental impact of one contact with friction: impulses, energy and the end of the two phases.

The normal impulse N grows from 0 and takes the place of time. Friction is Coulomb's at every instant:
``d gamma = G (1, f) dN`` with ``f = -D^2 gamma_t / |D gamma_t|``, ``D = diag(mu)``, while the contact slides. Once it
has stopped, f is constant: it is the f in the ellipse ``|D^-1 f| <= 1`` that changes ``gamma_t`` least. That is
sticking, or sliding along a constant direction, which is the reversal of slip where there is one tangential direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy

from impactlaw.errors import SolverError

Hypothesis = Literal["poisson", "stronge"]
_ROUNDING = 1e-12  # part of a sum that is left of it where its terms cancel
_STOPS = 1e-8  # part of the speed that counts as none where slip has stopped, which is found to 1e-9
_WITHIN = 1e-9  # share of a phase in which slip turns, up to which its end counts as reached
_CUTS = 12  # of a phase, one after another
_FAR = (6.0, 40.0, 1e3)  # impulse, in units of what stops the approach without friction, up to which slip is followed


class Path(NamedTuple):
    """What decides how slip turns."""

    G: np.ndarray  # Delassus matrix, normal row first, (1 + k, 1 + k)
    mu: np.ndarray  # coefficients, (k,)
    speed: float  # in which slip and impulses along it are measured, m/s


class Phase(NamedTuple):
    """A stretch of N with the mean friction in it: velocities are linear in N, or right at its ends if slip turns."""

    end: float  # normal impulse at which it ends, N s
    f: np.ndarray  # friction over normal impulse, (k,)
    lag: float = 0.0  # normal work beyond that of the mean friction, J
    slip: np.ndarray | None = None  # before it, over the speed, (k,)
    ds: float = 0.0  # its step; 0 where friction is constant
    path: Path | None = None
    cuts: int = 0  # how often it has been cut

    def cut(self, begin: float, length: float) -> tuple[Phase, ...]:
        """Return its parts up to a normal impulse, counted from its begin, and from there; none where it ends there."""
        whole = self.end - begin
        if self.path is None or self.cuts >= _CUTS or not _WITHIN * whole < length < (1.0 - _WITHIN) * whole:
            return ()
        from impactlaw.laws.friction.routh_slip import part_of

        G, mu, speed = self.path
        ds, *first = part_of(G, mu, self.slip, self.ds, length / speed)
        rest, *second = part_of(G, mu, first[0], self.ds - ds, np.inf)
        if not (first[1] > 0.0 and second[1] > 0.0):  # it ends there but for rounding
            return ()
        one = self._part(begin, self.slip, ds, first)
        return one, self._part(one.end, first[0], rest, second)

    def _part(self, begin: float, slip: np.ndarray | None, ds: float, taken: list[Any]) -> Phase:
        _, done, impulse, moment = taken
        assert self.path is not None
        G, _, speed = self.path
        lag = speed * speed * float(G[0, 1:] @ (moment - 0.5 * done * impulse))
        return Phase(begin + speed * done, impulse / done, lag, slip, ds, self.path, self.cuts + 1)


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
        steps, stopped = sliding(G, slip / speed, mu, approach / speed, far)
        ends, ds, (slips, f, lags) = steps[taken:, 0], steps[taken:, 1], np.split(steps[taken:, 2:], 3, axis=1)
        path, lags = Path(G, mu, speed), speed * (speed * lags @ G[0, 1:])
        for end, mean, lag, before, step in zip(
            (speed * ends).tolist(), f, lags.tolist(), slips, ds.tolist(), strict=True
        ):
            yield Phase(end, mean, lag, before, step, path if step else None)
        taken = len(steps)
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
    compression, phases = np.inf, iter(phases)
    while (phase := next(phases, None)) is not None:
        direction = np.concatenate([[1.0], phase.f])
        rates, lag = _rates(G, direction), phase.lag
        length = phase.end - begin
        if compression == np.inf and velocity[0] >= -speed * (_ROUNDING if rates[0] else _STOPS):
            velocity[0], compression = 0.0, begin
        if compression == np.inf and velocity[0] + rates[0] * length >= 0.0 and rates[0] > 0.0:
            part = -velocity[0] / rates[0]
            if pieces := phase.cut(begin, part):
                phases = chain(pieces, phases)
                continue
            late = part > 0.5 * length  # it ends where the phase does, or at its begin: there is no lag in what is left
            taken += 0.5 * velocity[0] * part + (lag if late else 0.0)
            lag = 0.0 if late else lag
            energy += _work(direction, velocity, rates, part)
            impulse, velocity, begin = impulse + part * direction, velocity + part * rates, begin + part
            velocity[0], compression = 0.0, begin
            length = phase.end - begin
        if compression < np.inf and length == np.inf and not rates.any():
            rest = (1.0 + e) * compression - begin if hypothesis == "poisson" else 0.0
            return impulse + max(rest, 0.0) * direction
        if compression == np.inf:
            taken += (velocity[0] + 0.5 * rates[0] * length) * length + lag
            energy += _work(direction, velocity, rates, length)
        else:
            if hypothesis == "poisson":
                rest = (1.0 + e) * compression - begin
            else:
                rest = _reaching(0.5 * rates[0], velocity[0], -(e * e) * taken - lag if e else 0.0)
            rest = min(rest, _reaching(0.5 * float(direction @ rates), float(direction @ velocity), -energy))
            if velocity[0] + rates[0] * max(rest, 0.0) < 0.0:  # slip has turned so that the contact closes again
                rest = -velocity[0] / rates[0] if rates[0] > 0.0 else np.inf
            if pieces := phase.cut(begin, rest):
                phases = chain(pieces, phases)
                continue
            if rest <= length:
                return impulse + max(rest, 0.0) * direction
            if hypothesis != "poisson" and e:  # normal work done in restitution, in units of work taken
                taken += ((velocity[0] + 0.5 * rates[0] * length) * length + lag) / (e * e)
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
