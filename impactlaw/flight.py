"""Flows between collisions: how far one leads, which contacts stay closed meanwhile, and when another gap closes.

A flow is MuJoCo's integrator without contacts (`flow.advance`). It is tried, shortened where bodies travel further than
they are thick (`flow.Travel`), brought back to the contacts that stay closed (`sustained.hold`), and where another gap
fell below minus the tolerance, repeated up to the time at which it closes (`location.locate`).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.contacts import update_positions
from impactlaw.detection import Detector
from impactlaw.flow import Frames, Travel, advance, restore_state
from impactlaw.location import Guess, locate, parabola
from impactlaw.matching import elsewhere, match, refound, runs_on
from impactlaw.moment import CORRECTED, Arrival, Flow, Moment, stays
from impactlaw.patterns import Pattern
from impactlaw.plan import Plan
from impactlaw.surfaces import Surfaces
from impactlaw.sustained import hold
from impactlaw.touch import Touch

_LOCATED = 1e-2  # part of the gap tolerance to which a closing gap is located
_SMOOTH = 0.1  # part of its bent depth by which a smooth gap may miss a quarter of it after half of the flow
_SHORTER = 0.1  # part of a flow over which a contact that closes in its end may rest instead
_NEAR = 1e3  # gap tolerances within which contacts are looked for


class Flight(NamedTuple):
    """A flow that has been tried: the contacts at its end, and the smallest gap among those that are not held.

    Attributes:
        flow: what has been tried.
        arrival: the contacts at its end.
        gap: smallest gap among those that are not held, m. A contact that was deeper at the start counts as touching.
        deepest: index of that contact, -1 where none is near.
    """

    flow: Flow
    arrival: Arrival
    gap: float
    deepest: int

    @property
    def rate(self) -> float:
        """Contact velocity of the deepest contact, m/s; 0 where none is near."""
        return float(self.arrival.now.contact_velocity[self.deepest]) if self.deepest >= 0 else 0.0


class Flights:
    """Flies from one moment towards the end of a step.

    Args:
        model: the scene.
        plan: what the scene can need.
        gap_tolerance: gap up to which a contact counts as closed, m.
        exact: whether friction is exact, or its convex relaxation.

    Attributes:
        tolerance: the gap tolerance, m.
        farthest: as in `Travel`.
        options: to be entered (``with``) around every use.
        surfaces: surfaces that move by themselves; None if the scene has none.
    """

    def __init__(self, model: mujoco.MjModel, plan: Plan, gap_tolerance: float, *, exact: bool):
        self._model = model
        self.tolerance = gap_tolerance
        self._near = _NEAR * gap_tolerance
        self._detector = Detector(model, convex=plan.convex, faces=plan.faces, friction=plan.friction)
        self._exact = exact
        self._travel = Travel(model, plan.pairs, passing=plan.passing, turning=plan.turning)
        self._passing = plan.passing
        self.farthest = self._travel.farthest
        self.options = self._detector.options
        self.surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces else None

    @property
    def is_steady(self) -> bool:
        """Whether no surface moves by itself in this step, or can be told to run without a pose to tell."""
        return self.surfaces is None or (self.surfaces.still and not self.surfaces.run)

    def update(self, data: mujoco.MjData) -> None:
        """Bring frames and inertia up to data.qpos, and surfaces that move by themselves to where they are now."""
        if self.surfaces is not None:
            self.surfaces.place(data)
        update_positions(self._model, data)

    def advance(self, data: mujoco.MjData, duration: float) -> None:
        """Integrate for ``duration`` s without contacts."""
        if self.surfaces is not None:
            self.surfaces.aim(data)
        advance(self._model, data, self.options, duration)
        self.update(data)

    def _is_short(self, before: np.ndarray, after: np.ndarray, duration: float) -> bool:
        if self.surfaces is None:
            return self._travel.is_short(before, after, duration)
        return self._travel.is_short(before, after, duration, drift=self.surfaces.speed)

    def look(self, data: mujoco.MjData, within: float = 0.0) -> Moment:
        """Return the contacts of now, of a gap up to ``within``, m or rad, at least; frames must be current."""
        touch = Touch(self._detector.look(data, max(self._near, within)), data, self.surfaces)
        return Moment.of(self._model, data, touch, tolerance=self.tolerance, timestep=self.options.timestep)

    def refresh(self, data: mujoco.MjData, pattern: Pattern) -> None:
        """Leave in data.contact what `look` leaves there where the pattern is known, and read nothing."""
        self._detector.refresh(data, self._near, pattern)

    def frames(self, data: mujoco.MjData) -> Frames | None:
        """Return the frames of all geoms of now; None if no body can pass through another."""
        return Frames.of(data) if self._passing else None

    def leap(self, data: mujoco.MjData, start: Frames | None = None) -> bool:
        """Advance by a timestep in one go; return whether no body can have passed through another meanwhile.

        Args:
            data: the state.
            start: frames at the start; without them this is told from velocities only.
        """
        before, timestep = data.qvel.copy(), self.options.timestep
        self.advance(data, timestep)
        if self._is_short(before, data.qvel, timestep):
            return True
        return start is not None and self._travel.is_safe(start, before, data, timestep)

    def is_near(self, data: mujoco.MjData) -> bool:
        """Return whether a contact is near now; frames must be current."""
        return bool(self._detector.look(data, self._near).pattern)

    def are_closed(self, data: mujoco.MjData, pattern: Pattern) -> bool:
        """Return whether the contacts near now are those of a plain pattern, closed, and need no correction."""
        return self._detector.are_closed(data, self._near, pattern, (-CORRECTED * self.tolerance, self.tolerance))

    def fly(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool
    ) -> tuple[Flight, bool]:
        """Advance from a saved state by at most ``duration``; return where that led, and whether a gap closed there."""
        flight = self._try_safely(data, state, start, duration, hold_all=hold_all)
        if hold_all or flight.gap >= -self.tolerance:
            return flight, False

        def again(time: float, *, smooth: bool = False) -> Flight:
            restore_state(self._model, data, state)
            return self._try(data, start, time, reach=reach, smooth=smooth)

        tried, reach = flight.flow, 4.0 * abs(flight.gap) + self._near
        longest = self._travel.between(start.touch.frames, data).max()
        guess = self._guess(data, flight)
        begun = elsewhere(flight.arrival, tried, flight.deepest, flight.gap)
        if begun is not None:
            half, (straight, bent) = again(0.5 * tried.duration), begun
            smooth = abs(half.gap - straight - 0.25 * bent) <= _SMOOTH * abs(bent)
            if smooth or runs_on(half.arrival, flight.arrival, tried, flight.deepest):
                held = again(tried.duration, smooth=True)
                if held.gap >= -self.tolerance:
                    return held, False
        shortest = tried.duration * self.tolerance / max(longest, self.tolerance)
        located = locate(
            again,
            flight,
            tried.duration,
            guess,
            target=_LOCATED * self.tolerance,
            tolerance=self.tolerance,
            shortest=shortest,
            enough=self._rests,
        )
        if self._was_closed(located) and located.flow.duration > 2.0 * shortest:
            # at rest over shorter flows (`sustained.stays`), not over longer ones: it rests up to there
            held = again(located.flow.duration - 2.0 * shortest)
            return (held, True) if held.gap >= -self.tolerance else (again(located.flow.duration), True)
        return located, True

    def _rests(self, end: Flight, shorter: Flight) -> bool:
        """Return whether the contact that closes in the end, closed at the start, stays closed over a shorter flow."""
        before = end.arrival.known[end.deepest]
        if shorter.gap < -self.tolerance or before < 0 or shorter.flow.duration < _SHORTER * end.flow.duration:
            return False
        return bool(shorter.arrival.sustained[shorter.arrival.known == before].any())

    def _was_closed(self, end: Flight) -> bool:
        """Return whether the deepest contact penetrates and was closed, and no deeper, at the start of the flow."""
        if end.gap >= -self.tolerance:
            return False
        start, before = end.flow.start, end.arrival.known[end.deepest]
        return bool(before >= 0 and abs(start.gap[before]) <= self.tolerance)

    def _try_safely(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool
    ) -> Flight:
        while True:
            self.advance(data, duration)
            if self._is_short(start.velocity, data.qvel, duration):
                return self._arrive(
                    data, Flow(start, duration, self.tolerance, self._travel, hold_all, exact=self._exact)
                )
            longest = self._travel.longest_turn(start.velocity)
            if duration > longest:
                restore_state(self._model, data, state)
                duration = longest
                continue
            travel = self._travel.between(start.touch.frames, data)
            suspects = self._travel.suspects(start.touch.frames, travel)
            if len(suspects) == 0:
                return self._arrive(
                    data, Flow(start, duration, self.tolerance, self._travel, hold_all, exact=self._exact)
                )
            restore_state(self._model, data, state)
            self.update(data)
            fraction = self._travel.safe_fraction(data, suspects, travel)
            if fraction >= 1.0:
                return self._try(data, start, duration, hold_all=hold_all)
            duration *= 0.9 * fraction

    def _try(
        self,
        data: mujoco.MjData,
        start: Moment,
        duration: float,
        *,
        hold_all: bool = False,
        smooth: bool = False,
        reach: float = 0.0,
    ) -> Flight:
        self.advance(data, duration)
        return self._arrive(
            data, Flow(start, duration, self.tolerance, self._travel, hold_all, smooth, self._exact), reach
        )

    def _arrive(self, data: mujoco.MjData, flow: Flow, reach: float = 0.0) -> Flight:
        """Look at the contacts where the flow has led, and hold those that stay closed.

        Args:
            data: at the end of the flow.
            flow: what led there.
            reach: distance to look further if nothing is near, m.
        """
        now = self.look(data)
        known = match(self._model, data, now.touch, flow)
        if not now.touch.pattern:
            return Flight(flow, Arrival(now, known, known), self._further(data, reach), -1)
        if (
            now.quiet
            and flow.start.quiet
            and now.touch.pattern is flow.start.touch.pattern
            and now.touch.pattern.all_single
        ):
            return Flight(flow, Arrival(now, known, now.closed), self._further(data, reach), -1)
        arrival = Arrival(now, known, stays(now.gap, known, flow))
        if np.count_nonzero(arrival.sustained & now.closed):
            held = known[arrival.sustained]

            def look_again(within: float) -> tuple[Moment, np.ndarray]:
                now = self.look(data, within)
                return now, refound(match(self._model, data, now.touch, flow), held, now.touch, flow)

            arrival = hold(self._model, data, arrival, flow, look_again)
        smallest, deepest = self._smallest_gap(data, arrival, flow, reach)
        return Flight(flow, arrival, smallest, deepest)

    def _smallest_gap(self, data: mujoco.MjData, arrival: Arrival, flow: Flow, reach: float) -> tuple[float, int]:
        if np.count_nonzero(arrival.sustained) == len(arrival.sustained):
            return self._further(data, reach), -1
        opened = np.flatnonzero(~arrival.sustained)
        clear = arrival.now.gap[opened]
        if len(flow.start.gap):
            known = arrival.known[opened]
            before = np.where(known >= 0, flow.start.gap[known], 0.0)
            clear = clear - np.where(before < -self.tolerance, before, 0.0)
        least = int(clear.argmin())
        return float(clear[least]), int(opened[least])

    def _further(self, data: mujoco.MjData, reach: float) -> float:
        """Return the smallest gap, up to ``reach``, of contacts that are not near."""
        if reach <= self._near:
            return self._near
        gap = self._detector.look(data, reach).contacts.gap
        return float(gap[gap > self._near].min(initial=reach))

    def _guess(self, data: mujoco.MjData, end: Flight) -> Guess:
        """Guess when the deepest contact that is not held has closed, from its velocities at both ends of the flow."""
        start, duration = end.flow.start, end.flow.duration
        before = end.arrival.known[end.deepest]
        if before >= 0:
            gap, velocity = float(start.gap[before]), float(start.contact_velocity[before])
        else:
            touch = end.arrival.now.touch
            velocity, after = (float(touch.contact_velocity(v)[end.deepest]) for v in (start.velocity, data.qvel))
            gap = end.gap - 0.5 * (velocity + after) * duration
        return parabola(max(gap, 0.0), velocity, end.gap, duration, self.tolerance)
