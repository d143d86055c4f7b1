"""The budget of work of the solvers in a time step, in operations, for a number of Newton steps."""

from impactlaw.solvers.cones.algebra.loops import Array, plain

LARGE = 300
"""Number of rows from which an island is large: there Newton's method soon stops making progress."""
_ALLOWED = 5e7  # operations of one time step ...
_STEPS_ALLOWED, _STEPS_OF_LARGE = 200.0, 60.0  # ... or Newton steps if these are more, the second in large islands
_MANY = 1e9  # Newton steps without a limit
_OF_ROW = 800.0  # operations of a Newton step per row, most of them in the line search


@plain
def _worth(step: float, rows: int) -> float:
    """Return the number of Newton steps allowed in a time step; for the arguments see `spend`."""
    whole = step + _OF_ROW * rows
    return max(_ALLOWED / whole, _STEPS_OF_LARGE if rows >= LARGE else _STEPS_ALLOWED)


@plain
def spend(left: Array, operations: float, step: float, rows: int) -> None:
    """Subtract operations from the remaining part of the work allowed in a time step.

    Args:
        left: the remaining part, (1,), which is 1 at the start of the time step.
        operations: number of operations done.
        step: operations of one Newton step of this problem, without those counted per row.
        rows: number of rows of the problem.
    """
    left[0] -= operations / (step * _worth(step, rows))


@plain
def affordable(left: Array, step: float, rows: int) -> int:
    """Return how many Newton steps the remaining work allows."""
    return int(min(max(0.0, left[0]) * _worth(step, rows), _MANY))
