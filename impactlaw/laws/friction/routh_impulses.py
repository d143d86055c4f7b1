"""Routh's incremental impact of one contact with friction: impulses, energy and the end of the two phases.

The normal impulse N grows from 0 and takes the place of time. Friction is Coulomb's at every instant:
``d gamma = G (1, f) dN`` with ``f = -D^2 gamma_t / |D gamma_t|``, ``D = diag(mu)``, while the contact slides. Once it
has stopped, f is constant: it is the f in the ellipse ``|D^-1 f| <= 1`` that changes ``gamma_t`` least. The contact
then sticks, or slides in a constant direction; with one tangential direction that is the reversal of slip.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy

from impactlaw.errors import SolverError

Hypothesis = Literal["poisson", "stronge"]
_ROUNDING = 1e-12  # size of a sum relative to its terms up to which it is rounding
_STOPS = 1e-8  # closing speed of a jammed contact, relative to before, that counts as 0: its stop is found to 1e-9
_WITHIN = 1e-9  # distance from an end of a phase with turning slip, relative to its length, that counts as 0
_CUTS = 12  # most times that a phase is cut
_FAR = (6.0, 40.0, 1e3)  # slip is followed up to these N, in units of the impulse that stops a frictionless approach


class Path(NamedTuple):
    """The data that determine how slip turns."""

    G: np.ndarray  # Delassus matrix, normal row first, (1 + k, 1 + k)
    mu: np.ndarray  # coefficients, (k,)
    speed: float  # the unit of slip and of impulses, m/s


class Phase(NamedTuple):
    """An interval of N with its mean friction; if slip turns, velocities linear in N are right only at its ends."""

    end: float  # normal impulse at which the phase ends, N s
    f: np.ndarray  # friction impulse over normal impulse, (k,)
    lag: float = 0.0  # normal work beyond that of the mean friction, J
    slip: np.ndarray | None = None  # slip at the beginning, in units of ``path.speed``, (k,)
    ds: float = 0.0  # step in s; 0 where friction is constant
    path: Path | None = None
    cuts: int = 0  # how often the phase has been cut

    def cut(self, begin: float, length: float) -> tuple[Phase, ...]:
        """Return the two parts of the phase when cut at ``begin + length``; () if that is one of its ends."""
        whole = self.end - begin
        if self.path is None or self.cuts >= _CUTS or not _WITHIN * whole < length < (1.0 - _WITHIN) * whole:
            return ()
        from impactlaw.laws.friction.routh_slip import part_of

        G, mu, speed = self.path
        ds, *first = part_of(G, mu, self.slip, self.ds, length / speed)
        rest, *second = part_of(G, mu, first[0], self.ds - ds, np.inf)
        if not (first[1] > 0.0 and second[1] > 0.0):  # a part is empty up to rounding
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
    """Return f of a contact that has stopped sliding, (k,): it minimizes ``|gamma_t'|`` in the metric of its mass."""
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
    """Yield the phases of a contact: those of slip until it stops, and the last one, after the stop.

    With ``dN = |gamma_t| ds`` slip is a smooth function of s up to its stop. It is integrated by Runge-Kutta steps of
    order four; each is a phase with its mean friction. Once slip keeps its direction, as it always does with one
    tangential direction, the rest of it is a single phase.

    Args:
        G: Delassus matrix, normal row first, (1 + k, 1 + k).
        slip: ``gamma_t-``, (k,).
        mu: coefficients of friction, (k,).
        approach: ``-gamma-`` of the normal, m/s.

    Raises:
        SolverError: slip has not settled at an impulse far beyond that of any impact without friction.
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

    `Routh` says where restitution ends; at the latest that is when the kinetic energy is back at its value before. A
    contact that jams as it stops, as that of a body on a hinge can, gives no energy back: further impulse moves no
    body. ``gamma`` are the velocities before, (1 + k,), normal first and negative; ``phases`` come from `phases_of`.

    Raises:
        SolverError: velocities, masses or coefficients are so large that their products overflow.
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
            late = part > 0.5 * length  # compression ends at an end of the phase: lag is that of the longer part
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
            if velocity[0] + rates[0] * max(rest, 0.0) < 0.0:  # slip has turned, and the contact would close again
                rest = -velocity[0] / rates[0] if rates[0] > 0.0 else np.inf
            if pieces := phase.cut(begin, rest):
                phases = chain(pieces, phases)
                continue
            if rest <= length:
                return impulse + max(rest, 0.0) * direction
            if hypothesis != "poisson" and e:  # work given back, over e^2 to compare with work absorbed
                taken += ((velocity[0] + 0.5 * rates[0] * length) * length + lag) / (e * e)
            energy += _work(direction, velocity, rates, length)
        impulse, velocity, begin = impulse + length * direction, velocity + length * rates, phase.end
    raise SolverError(
        f"the impulse of a contact that closes at {-gamma[0]:.3g} m/s with an effective mass of {1.0 / G[0, 0]:.3g} kg "
        "is no finite number; check the units of velocities and masses"
    )


def _rates(G: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return ``G @ direction``, the rates of contact velocities, (1 + k,), with 0 for those that are only rounding."""
    rates = G @ direction
    rates[np.abs(rates) <= _ROUNDING * (np.abs(G) @ np.abs(direction))] = 0.0
    return rates


def _work(direction: np.ndarray, velocity: np.ndarray, rates: np.ndarray, length: float) -> float:
    return float(direction @ velocity) * length + 0.5 * float(direction @ rates) * length * length


def _reaching(a: float, b: float, c: float) -> float:
    """Return the x >= 0 at which ``a x^2 + b x`` first rises to c, for c >= 0; infinite if it never does."""
    if c <= 0.0 and b >= 0.0:
        return 0.0 if (b > 0.0 or a >= 0.0) else np.inf
    root = b * b + 4.0 * a * c
    if root < 0.0:
        return np.inf
    root = np.sqrt(root)
    if a > 0.0:
        return 2.0 * c / (b + root) if b > 0.0 else (root - b) / (2.0 * a)
    return 2.0 * c / (b + root) if b > 0.0 else np.inf
