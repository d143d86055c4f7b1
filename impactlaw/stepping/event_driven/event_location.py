"""The time at which the first gap closes: by cubics through what flows have shown, in a bracket, at last bisection."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

from impactlaw.stepping.event_driven.gap_functions import Courses, Sight

_EVALUATIONS = 100
_PATIENCE = 8  # flows that cubics are trusted for, of which smooth gaps take two or three


class Flown(Protocol):
    """How a flow has ended."""

    @property
    def duration(self) -> float:
        """Of the flow, s."""
        ...

    @property
    def gap(self) -> float:
        """Smallest gap at its end, m."""
        ...

    @property
    def sights(self) -> Iterable[Sight]:
        """Contacts there that are not held."""
        ...


F = TypeVar("F", bound=Flown)


def locate(
    fly: Callable[[float], F],
    end: F,
    courses: Courses,
    *,
    target: float,
    tolerance: float,
    shortest: float,
    enough: Callable[[F, F], bool],
) -> F:
    """Return the flight at whose end the smallest gap is zero, or one that is enough.

    Args:
        fly: flies for a given time from the start and returns how it ended.
        end: a flight whose gap is negative.
        courses: what flights so far have shown, that one included.
        target: size of the gap at which the search ends, m.
        tolerance: size of the gap that is good enough for the bisection, m.
        shortest: time in which nothing moves as far as the tolerance, s.
        enough: whether a flight may be kept although no gap closes at its end; asked with a longer one that overlaps.

    Returns:
        The last flight flown. A gap that jumps from open to closed (a new contact point on an edge) has no zero; then
        it is the earliest flight after the jump.
    """
    low, high = courses.low, end.duration
    patience = _PATIENCE
    for _ in range(_EVALUATIONS):
        time = courses.closing(low, high) if patience else None
        if time is None:
            time = 0.5 * (low + high)
        else:
            patience -= 1
        if high - low <= shortest or not low < time < high:
            break
        flight = fly(time)
        if abs(flight.gap) <= (target if patience else tolerance) or enough(end, flight):
            return flight
        courses.add(time, flight.sights)
        if flight.gap > 0:
            low = time
        else:
            high, end = time, flight
    return fly(high)
