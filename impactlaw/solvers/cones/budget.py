"""The work that solvers may do in a time step: operations of the Newton steps that it is worth."""

from impactlaw.solvers.cones.algebra.loops import Array, plain

LARGE = 300
"""Rows of an island where Newton's method soon gets no further."""
_ALLOWED = 5e7  # operations of one time step ...
_STEPS_ALLOWED, _STEPS_OF_LARGE = 200.0, 60.0  # ... or Newton steps if these are more, the second in large islands
_MANY = 1e9  # Newton steps, where nothing limits them
_OF_ROW = 800.0  # operations of a Newton step in each row, most of them in the line search


@plain
def _worth(step: float, rows: int) -> float:
    """Return how many Newton steps are allowed in a time step; see `spend`."""
    whole = step + _OF_ROW * rows
    return max(_ALLOWED / whole, _STEPS_OF_LARGE if rows >= LARGE else _STEPS_ALLOWED)


@plain
def spend(left: Array, operations: float, step: float, rows: int) -> None:
    """Take operations from the part of the work allowed in a time step that is left, (1,).

    Args:
        left: 1 at the start of the step.
        operations: that were done.
        step: operations of one Newton step of this problem, without those that are few in each row.
        rows: of it.
    """
    left[0] -= operations / (step * _worth(step, rows))


@plain
def affordable(left: Array, step: float, rows: int) -> int:
    """Return how many Newton steps can be taken with what is left."""
    return int(min(max(0.0, left[0]) * _worth(step, rows), _MANY))
