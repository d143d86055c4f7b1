"""Find the time at which the first gap closes, by cubics through trial steps in a bracket, or by bisection."""

from __future__ import annotations

from collections.abc import Callable

from impactlaw.stepping.event_driven.location.gap_functions import GapFunctions
from impactlaw.stepping.event_driven.location.trial_step import TrialStep

_EVALUATIONS = 100
_PATIENCE = 8  # number of trial steps at zeros of cubics; smooth gaps take two or three


def locate(
    try_for: Callable[[float], TrialStep],
    end: TrialStep,
    gap_functions: GapFunctions,
    *,
    target: float,
    tolerance: float,
    shortest: float,
) -> TrialStep:
    """Return the trial step at whose end the smallest gap is zero.

    Args:
        try_for: advances from the start for a given time and returns the trial step.
        end: a trial step whose gap is negative.
        gap_functions: the gaps that trial steps so far, including ``end``, have shown.
        target: size of the gap at which the search ends, m.
        tolerance: size of the gap at which bisection ends, m.
        shortest: time in which nothing moves as far as the tolerance, s.

    Returns:
        The last trial step. A gap that jumps from open to closed (a new contact point on an edge) has no zero; then it
        is the earliest trial step after the jump.
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
        trial_step = try_for(time)
        if abs(trial_step.gap) <= (target if patience else tolerance):
            return trial_step
        gap_functions.add(time, trial_step.observations)
        if trial_step.gap > 0:
            low = time
        else:
            high = time
    return try_for(high)
