"""The time at which a gap closes: a guess from a parabola, bracketed Newton or secant steps, at last bisection."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

_EVALUATIONS = 100
_PATIENCE = 8  # evaluations of the secant, of which a smooth gap takes two to four


class HasGap(Protocol):
    """Anything with the smallest gap at its end."""

    @property
    def gap(self) -> float:
        """Smallest gap, m."""
        ...

    @property
    def rate(self) -> float:
        """Its rate, m/s; 0 where it is not known."""
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
        height = 0.5 * velocity0 * top + gap0
        if gap0 <= tolerance < height:
            return Guess((velocity0 + root) / a, top, height)
        return Guess((velocity0 + root) / a, 0.0, max(gap0, tolerance))
    time = 2.0 * gap0 / (root - velocity0) if root > velocity0 else 0.5 * duration
    return Guess(time, 0.0, max(gap0, tolerance))


def locate(
    fly: Callable[[float], F],
    end: F,
    duration: float,
    guess: Guess,
    *,
    target: float,
    tolerance: float,
    shortest: float,
    enough: Callable[[F, F], bool],
) -> F:
    """Return the flight at whose end the smallest gap is zero, or one that is enough.

    Args:
        fly: flies for a given time from the start and returns how it ended.
        end: the flight of the whole duration, whose gap is negative.
        duration: of that flight, s.
        guess: where to look first.
        target: size of the gap at which the search ends, m.
        tolerance: size of the gap that is good enough for the bisection, m.
        shortest: time in which nothing moves as far as the tolerance, s.
        enough: whether a flight may be kept although no gap closes at its end; asked with a longer one that overlaps.

    Returns:
        The last flight flown. A gap that jumps from open to closed (a new contact point on an edge) has no zero; then
        it is the earliest flight after the jump.
    """
    low, gap_low, seen = guess.open_time, guess.open_gap, False
    high, gap_high = duration, end.gap
    time = guess.time
    for evaluation in range(_EVALUATIONS):
        if evaluation >= _PATIENCE or not low < time < high:
            time = 0.5 * (low + high)
        if high - low <= shortest or not low < time < high:
            if seen or low == 0.0:
                break
            low, gap_low, seen = 0.0, tolerance, True  # the gap was not open where it was believed to be
            continue
        flight = fly(time)
        if abs(flight.gap) <= (target if evaluation < _PATIENCE else tolerance) or enough(end, flight):
            return flight
        if flight.gap > 0:
            gap_high *= 0.5 if seen and low > 0 and flight.gap > 0.5 * gap_low else 1.0
            low, gap_low, seen = time, flight.gap, True
        else:
            gap_low *= 0.5 if flight.gap < 0.5 * gap_high else 1.0
            high, gap_high, end = time, flight.gap, flight
        newton = time - flight.gap / flight.rate if flight.rate < 0 else low
        time = newton if low < newton < high else low + (high - low) * gap_low / (gap_low - gap_high)
    return fly(high)
