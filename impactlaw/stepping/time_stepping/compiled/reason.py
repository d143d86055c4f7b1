"""Whether compiled code takes the steps of a scene under a law."""

from __future__ import annotations

from impactlaw.laws.fremond import Reversal
from impactlaw.stepping.compiled import law_table
from impactlaw.stepping.time_stepping.scheme import TimeStepping


def reason(scheme: TimeStepping) -> str | None:
    """Return why compiled code does not take a scheme; None if it does."""
    if isinstance(scheme.problem.targets.law, Reversal) and not scheme.model.neq:
        return None
    return law_table.reason(scheme.problem.targets)
