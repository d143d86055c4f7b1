"""The time at which the first gap closes: by cubics through what flows have shown, in a bracket, at last bisection."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

from impactlaw.stepping.event_driven.gap_functions import GapFunctions, Observation

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
    def observations(self) -> Iterable[Observation]:
        """Contacts there that are not held."""
        ...


F = TypeVar("F", bound=Flown)


def locate(
    advance_to_contact: Callable[[float], F],
    end: F,
    gap_functions: GapFunctions,
    *,
    target: float,
    tolerance: float,
    shortest: float,
    enough: Callable[[F, F], bool],
) -> F:
    """Return the flight at whose end the smallest gap is zero, or one that is enough.

    Args:
        advance_to_contact: flies for a given time from the start and returns how it ended.
        end: a flight whose gap is negative.
        gap_functions: what flights so far have shown, that one included.
        target: size of the gap at which the search ends, m.
        tolerance: size of the gap that is good enough for the bisection, m.
        shortest: time in which nothing moves as far as the tolerance, s.
        enough: whether a flight may be kept although no gap closes at its end; asked with a longer one that overlaps.

    Returns:
        The last flight flown. A gap that jumps from open to closed (a new contact point on an edge) has no zero; then
        it is the earliest flight after the jump.
    """
    low, high = gap_functions.low, end.duration
    patience = _PATIENCE
    for _ in range(_EVALUATIONS):
        time = gap_functions.closing(low, high) if patience else None
        if time is None:
            time = 0.5 * (low + high)
        else:
            patience -= 1
        if high - low <= shortest or not low < time < high:
            break
        trial_step = advance_to_contact(time)
        if abs(trial_step.gap) <= (target if patience else tolerance) or enough(end, trial_step):
            return trial_step
        gap_functions.add(time, trial_step.observations)
        if trial_step.gap > 0:
            low = time
        else:
            high, end = time, trial_step
    return advance_to_contact(high)
