"""The time at which a gap closes: a first guess from a parabola, then a bracketed secant (Illinois)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

_EVALUATIONS = 100  # of which a smooth gap takes two or three and a jump in the gap about fifty
_EXACT = 8  # evaluations after which a gap within the tolerance is good enough: gaps of convex geoms are noisy


class HasGap(Protocol):
    """Anything with the smallest gap at its end."""

    @property
    def gap(self) -> float:
        """Smallest gap, m."""
        ...


F = TypeVar("F", bound=HasGap)


@dataclass(frozen=True)
class Guess:
    """Where to look first.

    Attributes:
        time: first guess of the closing time, s.
        open_time: a time before it at which the gap is believed open, s.
        open_gap: the gap believed there, m, positive.
    """

    time: float
    open_time: float
    open_gap: float


def parabola(gap0: float, velocity0: float, gap1: float, duration: float, tolerance: float) -> Guess:
    """Guess from gap and gap velocity at the start and the gap at the end, ``g0 + v0 t - a t^2 / 2``.

    A gap that starts closed and opens is believed open at the parabola's top.
    """
    a = 2.0 * (gap0 + velocity0 * duration - gap1) / duration**2
    root = math.sqrt(max(0.0, velocity0**2 + 2.0 * a * gap0))
    if velocity0 > 0 and a > 0:
        top = velocity0 / a
        opens = gap0 <= tolerance
        return Guess((velocity0 + root) / a, top if opens else 0.0, 0.5 * velocity0 * top + gap0 if opens else gap0)
    time = 2.0 * gap0 / (root - velocity0) if root > velocity0 else 0.5 * duration
    return Guess(time, 0.0, max(gap0, tolerance))


def locate(fly: Callable[[float], F], end: F, duration: float, guess: Guess, *, target: float, tolerance: float) -> F:
    """Return the flight at whose end the smallest gap is zero.

    Args:
        fly: flies for a given time from the start and returns how it ended.
        end: the flight of the whole duration, whose gap is negative.
        duration: of that flight, s.
        guess: where to look first.
        target: size of the gap at which the search ends, m.
        tolerance: size of the gap that is good enough where the target cannot be met in floating point, m.

    Returns:
        The last flight flown. A gap that jumps from open to closed (a new contact point on an edge) has no zero; then
        it is the earliest flight after the jump.
    """
    low, gap_low, opened = guess.open_time, guess.open_gap, False
    high, gap_high = duration, end.gap
    time = guess.time
    for evaluation in range(_EVALUATIONS):
        if not low < time < high:
            time = 0.5 * (low + high)
        if not low < time < high:
            break
        flight = fly(time)
        if abs(flight.gap) <= (target if evaluation < _EXACT else tolerance):
            return flight
        before = high, gap_high
        if flight.gap > 0:
            gap_high *= 0.5 if opened and flight.gap > 0.5 * gap_low else 1.0
            low, gap_low, opened = time, flight.gap, True
        else:
            gap_low *= 0.5 if opened and flight.gap < 0.5 * gap_high else 1.0
            high, gap_high = time, flight.gap
        if opened:
            time = low + (high - low) * gap_low / (gap_low - gap_high)
        elif evaluation < _EXACT:  # not seen open yet: the secant through the last two times it was closed
            time = high - gap_high * (before[0] - high) / (before[1] - gap_high) if before[1] != gap_high else low
        elif evaluation < 2 * _EXACT:  # it may not be open anywhere: go towards the start in long strides
            low, time = 0.0, 0.1 * high
        else:
            break
    last = fly(high)
    if last.gap < -tolerance and opened and gap_low <= tolerance:
        return fly(low)
    return last
