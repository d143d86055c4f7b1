"""Limit the work of a step: it is counted from sizes, not timed, so that runs are the same on every machine.

One unit is about a millisecond on one core of an AMD EPYC.
"""

from __future__ import annotations

from impactlaw.errors import UnfinishedStepError
from impactlaw.solvers.friction.solve import BRIEF, STEPS_OF_A_ROUND, cost

_FLOW, _PER_FREEDOM = 0.05, 0.004
_LOOK, _PER_CONTACT, _LOOK_PER_FREEDOM = 0.08, 0.01, 0.006
_CONVEX = 0.3  # a look at geoms that the general convex collider measures, such as meshes
_HOLD, _CONFLICT, _CUT = 0.15, 0.25, 2e-3
_COLLISION, _PER_PARTNER = 0.4, 0.004
_RUBBING, _DENSE = 0.6, 3e-6  # collisions with friction are dense: add the cube of the degrees of freedom
_FACTOR = 5e-8  # the same for a step that collides once: the mass matrix alone, without later looks
_IMPACT = 0.3  # making and auditing an impact with friction
_SHARING, _MOST_ROWS = 2e-7, 2  # redundant contacts share impulses: cube of the rows, at most 2 per degree of freedom
_COUPLED = 1e-7  # finding which rows influence which: times the square of the rows and the degrees of freedom
_STEPS = 3000  # solver steps in such a step; of the problems that need more, only one in thousands is ever solved
_PART = 20.0  # work that contacts that influence no others may take for themselves, in a step that collides once


class Work:
    """Counts the work of one step.

    Args:
        freedoms: degrees of freedom of the scene.
        most: number of units that a step may take.
        convex: whether the general convex collider looks for contacts.
        rounds: number of rounds of slower methods that a problem of contacts with friction may have.
        once: whether a step collides at one time only, without later looks at contacts.

    Attributes:
        hasty: whether restitution is left out as soon as no impulses are found for it, as in a step that collides once.
    """

    def __init__(self, freedoms: int, most: float, *, convex: bool = False, rounds: int = BRIEF, once: bool = False):
        self._freedoms, self._most, self._spent, self._rounds = freedoms, most, 0.0, rounds
        self._dense, self._sharing = (_FACTOR, _SHARING) if once else (_DENSE, 0.0)
        self.hasty = once
        self._look = _LOOK + _LOOK_PER_FREEDOM * freedoms + (_CONVEX if convex else 0.0)

    def begin(self, part: float = 1.0) -> None:
        """Start a step, or something that may take only this part of the work of a step."""
        self._spent = (1.0 - part) * self._most

    def _spend(self, units: float) -> None:
        self._spent += units
        if self._spent > self._most:
            raise UnfinishedStepError(
                "a step takes more work than it may; use a smaller timestep, a larger max_events, or "
                'scheme="time-stepping"'
            )

    def integrate(self) -> None:
        """Count one smooth phase."""
        self._spend(_FLOW + _PER_FREEDOM * self._freedoms)

    def look(self, contacts: int) -> None:
        """Count one look at this number of contacts, or distances of geoms, and what follows from it."""
        self._spend(self._look + _PER_CONTACT * contacts)

    def hold(self, contacts: int) -> None:
        """Count closing the gaps of this number of contacts again."""
        self._spend(_HOLD + _PER_CONTACT * contacts)

    def disagree(self, contacts: int) -> None:
        """Count one problem of this number of contacts that turned out to have no solution."""
        self._spend(_CONFLICT * contacts)

    def cut(self, contacts: int) -> None:
        """Count one problem of contacts that jump between points of faces, together with the contacts seen before."""
        self._spend(_CUT * contacts**2)

    def rounds(self, rows: int) -> int:
        """Return how many rounds of slower methods a problem of contacts with friction may have, at least 1."""
        return max(1, min(self._rounds, int(self._left(rows) / STEPS_OF_A_ROUND)))

    def steps(self, rows: int) -> float:
        """Return how many solver steps a problem of contacts with friction may take, at least 0."""
        start, spent = cost(rows, self._freedoms)[0], self._spent
        self._spend(self._impact(rows) + start)
        self._spent = spent
        return min(self._left(rows), _STEPS) if self.hasty else self._left(rows)

    def _left(self, rows: int) -> float:
        start, step = cost(rows, self._freedoms)
        return max(0.0, (self._most - self._spent - start) / step)

    def solve(self, rows: int, steps: int) -> None:
        """Count one problem of contacts with friction, which took this number of solver steps."""
        start, step = cost(rows, self._freedoms)
        self._spend(start + steps * step)

    def attempt(self, rows: int, steps: int) -> None:
        """Count one attempt to resolve a collision with friction: solving its problem, and making the impact."""
        self._spend(self._impact(rows))
        self.solve(rows, steps)

    def couple(self, rows: int) -> None:
        """Count finding which of these rows of contacts influence which, in a step that collides once."""
        if self.hasty:
            self._spend(_COUPLED * rows**2 * self._freedoms)

    def begin_part(self) -> None:
        """Start with contacts that influence no others.

        In a step that collides once, they need not share all the work with the rest.
        """
        if self._sharing:
            self._spent = min(self._spent, self._most - _PART)

    def _impact(self, rows: int) -> float:
        """Return the units for making an impact from an answer, where redundant contacts share their impulses."""
        shared = min(rows, _MOST_ROWS * self._freedoms) if rows > self._freedoms else 0
        return _IMPACT + self._sharing * shared**3

    def collide(self, contacts: int, *, friction: bool) -> None:
        """Count one collision before it is resolved; with friction, its `attempt` calls are counted separately."""
        if friction:
            self._spend(_RUBBING + _PER_PARTNER * contacts + self._dense * self._freedoms**3)
        else:
            self._spend(_COLLISION + _PER_PARTNER * contacts)
