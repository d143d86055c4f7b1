"""How much work a step may take: counted from sizes, not timed, so that runs are the same on every machine.

One unit is about a millisecond on one core of an AMD EPYC.
"""

from __future__ import annotations

from impactlaw.errors import UnfinishedStepError

_FLOW, _PER_FREEDOM = 0.05, 0.004
_LOOK, _PER_CONTACT = 0.08, 0.01
_HOLD, _CONFLICT, _CUT = 0.15, 0.25, 2e-3
_CONES, _PER_STEP, _PER_ROW = 0.1, 0.04, 8e-7  # dense solvers: the cube of the number of rows counts
_COLLISION, _PER_PARTNER = 0.4, 0.004
_RUBBING, _DENSE = 0.6, 3e-6  # collisions with friction are dense: the cube of the degrees of freedom counts, too
_FIRST = 5  # steps of Newton's method that a problem usually takes
_ATTEMPTS = 50  # steps of Newton's method in a collision with friction
_ROWS = 3  # of a contact with friction


class Work:
    """Counts the work of one step.

    Args:
        freedoms: degrees of freedom of the scene.
        most: units that a step may take.
    """

    def __init__(self, freedoms: int, most: float):
        self._freedoms, self._most, self._spent = freedoms, most, 0.0

    def begin(self, part: float = 1.0) -> None:
        """Let a step begin, or what may take a part of the work of one."""
        self._spent = (1.0 - part) * self._most

    def _spend(self, units: float) -> None:
        self._spent += units
        if self._spent > self._most:
            raise UnfinishedStepError(
                "a step takes more work than it may; use a smaller timestep, a larger max_events, or "
                'scheme="time-stepping"'
            )

    def fly(self) -> None:
        """Count one flow.

        Raises:
            UnfinishedStepError: this, as the others, is too much.
        """
        self._spend(_FLOW + _PER_FREEDOM * self._freedoms)

    def look(self, contacts: int) -> None:
        """Count one look at so many contacts, or distances of geoms, and what follows from it."""
        self._spend(_LOOK + _PER_CONTACT * contacts)

    def hold(self, contacts: int) -> None:
        """Count bringing so many contacts back."""
        self._spend(_HOLD + _PER_CONTACT * contacts)

    def disagree(self, contacts: int) -> None:
        """Count one problem of so many contacts that has turned out to have no solution."""
        self._spend(_CONFLICT * contacts)

    def cut(self, contacts: int) -> None:
        """Count one problem of contacts that jump between points of faces, and of those seen before."""
        self._spend(_CUT * contacts**2)

    def press(self, rows: int, steps: int = _FIRST) -> None:
        """Count one problem of contacts with friction, before it is solved; and the steps that it took, after."""
        self._spend(_CONES + steps * (_PER_STEP + _PER_ROW * rows**3))

    def collide(self, contacts: int, *, friction: bool) -> None:
        """Count one collision."""
        if not friction:
            self._spend(_COLLISION + _PER_PARTNER * contacts)
            return
        self._spend(_RUBBING + _ATTEMPTS * _PER_ROW * (_ROWS * contacts) ** 3 + _DENSE * self._freedoms**3)
