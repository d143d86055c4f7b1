"""Flows between collisions: how far one leads, which contacts stay closed meanwhile, and when another gap closes.

A flow is MuJoCo's integrator without contacts (`integration.advance`). It is tried, shortened where bodies travel
further than they are thick (`travel.Travel`), brought back to the contacts that stay closed
(`persistent_contact.hold`), and where another gap fell below minus the tolerance, repeated up to the time at which it
closes (`event_location.locate`).
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from impactlaw.scene.contacts import update_positions
from impactlaw.scene.detection import Detector
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.patterns import Pattern
from impactlaw.stepping.event_driven.contact_set import Touch
from impactlaw.stepping.event_driven.contact_state import CORRECTED, Arrival, Flow, Moment, stays
from impactlaw.stepping.event_driven.event_location import locate
from impactlaw.stepping.event_driven.gap_functions import Courses
from impactlaw.stepping.event_driven.matching import elsewhere, match, refound, runs_on
from impactlaw.stepping.event_driven.persistent_contact.felt_force import Felt, applied
from impactlaw.stepping.event_driven.persistent_contact.frictionless import hold
from impactlaw.stepping.event_driven.travel import Frames, Travel
from impactlaw.stepping.event_driven.trial_step import Flight, expected, further, rests
from impactlaw.stepping.integration import advance, restore_state
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.work import Work

_LOCATED = 1e-2  # part of the gap tolerance to which a closing gap is located
_SMOOTH = 0.1  # part of its bent depth by which a smooth gap may miss a quarter of it after half of the flow
_NEAR = 1e3  # gap tolerances within which contacts are looked for
_AHEAD = 3  # flows at most up to where a gap is expected to close, before one over all that remains
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


class Flights:
    """Flies from one moment towards the end of a step.

    Args:
        model: the scene.
        plan: what the scene can need.
        gap_tolerance: gap up to which a contact counts as closed, m.
        work: counts what a step has taken.
        exact: whether friction is exact, or its convex relaxation.

    Attributes:
        tolerance: the gap tolerance, m.
        farthest: as in `Travel`.
        work: as given.
        options: to be entered (``with``) around every use.
        surfaces: surfaces that move by themselves; None if the scene has none.
    """

    def __init__(self, model: mujoco.MjModel, plan: Plan, gap_tolerance: float, work: Work, *, exact: bool):
        self._model = model
        self.tolerance = gap_tolerance
        self._near = _NEAR * gap_tolerance
        self._detector = Detector(model, convex=plan.convex, faces=plan.faces, friction=plan.friction)
        self._exact = exact
        self.work = work
        self._travel = Travel(model, plan.pairs, passing=plan.passing, turning=plan.turning)
        self._passing = plan.passing
        self.farthest = self._travel.farthest
        self.options = self._detector.options
        self.surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces else None

    @property
    def is_steady(self) -> bool:
        """Whether no surface moves by itself in this step, nor is a belt that the model may start or stop."""
        return self.surfaces is None or (self.surfaces.still and not self.surfaces.run)

    def update(self, data: mujoco.MjData) -> None:
        """Bring frames and inertia up to data.qpos, and surfaces that move by themselves to where they are now."""
        if self.surfaces is not None:
            self.surfaces.place(data)
        update_positions(self._model, data)

    def advance(self, data: mujoco.MjData, duration: float, force: np.ndarray | None = None) -> None:
        """Integrate for ``duration`` s without contacts, or with this force of theirs applied, (nv,)."""
        if self.surfaces is not None:
            self.surfaces.aim(data)
        with applied(data, force):
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

    def _look_at_places(self, data: mujoco.MjData, within: float) -> Moment:
        """Return the contacts as `look` does, without their motion."""
        touch = Touch(self._detector.look(data, max(self._near, within)), data, self.surfaces)
        return Moment.without_motion(touch, tolerance=self.tolerance, timestep=self.options.timestep)

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
        flight, closed = self._fly(data, state, start, duration, hold_all=hold_all)
        return flight.kept(), closed

    def _fly(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool
    ) -> tuple[Flight, bool]:
        """Fly, and leave data at the end of the flight returned."""
        if hold_all:
            return self._try_safely(data, state, start, duration, hold_all=True), False
        courses, time = None, expected(start, self.tolerance)
        if time < duration:
            courses = self._courses(start)
            flight = self._fly_ahead(data, state, start, (time, duration), courses)
            if flight is not None:
                located = flight.gap >= -_LOCATED * self.tolerance
                return (flight, True) if located else self._locate(data, state, flight, courses)
        flight = self._try_safely(data, state, start, duration)
        if flight.gap >= -self.tolerance:
            return flight, False
        courses = self._courses(start) if courses is None else courses
        courses.add(flight.duration, flight.sights)
        return self._locate(data, state, flight, courses)

    def _fly_ahead(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, times: tuple[float, float], courses: Courses
    ) -> Flight | None:
        """Fly up to where a gap is expected to close; return that flight if one has closed there or before.

        Otherwise data is at the start again.

        Args:
            data: the state.
            state: the same, saved.
            start: contacts at the start.
            times: at which a gap is expected to close, and up to which one is looked for, s.
            courses: to add what the flights have shown.
        """
        time, last = times
        for _ in range(_AHEAD):
            flight = self._try_safely(data, state, start, time)
            courses.add(flight.duration, flight.sights)
            if abs(flight.gap) > _LOCATED * self.tolerance:
                if flight.gap < 0:
                    return flight
            elif courses.falls(flight.duration):
                return flight
            restore_state(self._model, data, state)
            time = courses.ahead(flight.duration)
            if time >= last:
                break
        self.update(data)
        return None

    def _courses(self, start: Moment) -> Courses:
        return Courses(start.gap, start.contact_velocity, exact=self._model.opt.integrator == _RK4)

    def _locate(self, data: mujoco.MjData, state: np.ndarray, flight: Flight, courses: Courses) -> tuple[Flight, bool]:
        """Return the flight up to the first gap that closes, where one has closed after a longer one, and whether."""
        start, tried = flight.flow.start, flight.flow
        reach = 4.0 * abs(flight.gap) + self._near

        def again(time: float, *, smooth: bool = False) -> Flight:
            restore_state(self._model, data, state)
            return self._try(data, state, start, time, reach=reach, smooth=smooth)

        longest = max(self._travel.between(start.touch.frames, data).max(initial=0.0), -flight.gap)
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
            courses,
            target=_LOCATED * self.tolerance,
            tolerance=self.tolerance,
            shortest=shortest,
            enough=rests,
        )
        if located.was_closed and located.duration > 2.0 * shortest:
            # at rest over shorter flows (`persistent_contact.stays`), not over longer ones: it rests up to there
            held = again(located.duration - 2.0 * shortest)
            return (held, True) if held.gap >= -self.tolerance else (again(located.duration), True)
        return located, True

    def _try_safely(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool = False
    ) -> Flight:
        while True:
            self.work.fly()
            self.advance(data, duration, start.force)
            if self._is_short(start.velocity, data.qvel, duration):
                break
            longest = self._travel.longest_turn(start.velocity)
            if duration > longest:
                restore_state(self._model, data, state)
                duration = longest
                continue
            travel = self._travel.between(start.touch.frames, data)
            suspects = self._travel.suspects(start.touch.frames, travel)
            if len(suspects) == 0:
                break
            restore_state(self._model, data, state)
            self.update(data)
            self.work.look(len(suspects))
            fraction = self._travel.safe_fraction(data, suspects, travel)
            if fraction >= 1.0:
                self.advance(data, duration, start.force)
                break
            duration *= 0.9 * fraction
        flow = Flow(start, duration, self.tolerance, self._travel, self.work, hold_all, exact=self._exact)
        return self._arrive(data, flow) or self._without_force(data, state, flow)

    def _try(
        self,
        data: mujoco.MjData,
        state: np.ndarray,
        start: Moment,
        duration: float,
        *,
        smooth: bool,
        reach: float,
    ) -> Flight:
        self.work.fly()
        self.advance(data, duration, start.force)
        flow = Flow(start, duration, self.tolerance, self._travel, self.work, smooth=smooth, exact=self._exact)
        return self._arrive(data, flow, reach) or self._without_force(data, state, flow, reach)

    def _without_force(self, data: mujoco.MjData, state: np.ndarray, flow: Flow, reach: float = 0.0) -> Flight:
        """Fly once more, without the force of contacts that are lost."""
        restore_state(self._model, data, state)
        flow = flow._replace(start=flow.start._replace(force=None))
        self.work.fly()
        self.advance(data, flow.duration)
        flight = self._arrive(data, flow, reach)
        assert flight is not None
        return flight

    def _match(self, data: mujoco.MjData, flow: Flow) -> tuple[Moment, np.ndarray] | None:
        """Return the contacts where the flow has led, and those at its start that they continue; see `match`.

        Contacts whose force the flow has felt are looked for as far as that can have moved them. None if they are lost.
        """
        now, start = self.look(data), flow.start
        self.work.look(len(now.gap))
        known = match(self._model, data, now.touch, flow)
        if start.force is None or start.pressed is None:
            return now, known
        pressed = np.flatnonzero(start.pressed)
        if np.isin(pressed, known).all():
            return now, known
        now.touch.whitened(self._model, data)
        shift = Felt.of(self._model, data, start.force, flow.duration).shift
        now = self.look(data, start.touch.opening(shift))
        known = match(self._model, data, now.touch, flow)
        return (now, known) if np.isin(pressed, known).all() else None

    def _arrive(self, data: mujoco.MjData, flow: Flow, reach: float = 0.0) -> Flight | None:
        """Look at the contacts where the flow has led, and hold those that stay closed.

        None if contacts are lost whose force the flow has felt.

        Args:
            data: at the end of the flow.
            flow: what led there.
            reach: distance to look further if nothing is near, m.
        """
        found = self._match(data, flow)
        if found is None:
            return None
        now, known = found
        if not now.touch.pattern:
            return self._clear(flow, Arrival(now, known, known), data, reach)
        if (
            now.quiet
            and flow.start.quiet
            and now.touch.pattern is flow.start.touch.pattern
            and now.touch.pattern.all_single
        ):
            return self._clear(flow, Arrival(now, known, now.closed), data, reach)
        arrival, keep = Arrival(now, known, stays(now.gap, known, flow)), None
        held = arrival.sustained if flow.start.force is not None else arrival.sustained & now.closed
        if np.count_nonzero(held):
            again = self._again(data, flow, arrival)
            arrival, keep = hold(self._model, data, arrival, flow, again)
        if np.count_nonzero(arrival.sustained) == len(arrival.sustained):
            return self._clear(flow, arrival, data, reach, keep)
        return Flight.of(flow, arrival, keep)

    def _again(self, data: mujoco.MjData, flow: Flow, arrival: Arrival) -> Callable[[float], tuple[Moment, np.ndarray]]:
        """Return what looks at the contacts of now up to a gap at least, m, and matches them with those at the start.

        Where the same pairs of geoms are near as before, with one contact each, these are the same contacts.
        """
        last, held = arrival, arrival.known[arrival.sustained]
        look = self.look if last.now.touch.pattern.grip is None else self._look_at_places

        def look_again(within: float) -> tuple[Moment, np.ndarray]:
            nonlocal last
            now, known, pattern = look(data, within), last.known, last.now.touch.pattern
            self.work.look(len(now.gap))
            if now.touch.pattern is not pattern or not pattern.distinct:
                known = refound(match(self._model, data, now.touch, flow), held, now.touch, flow)
            last = Arrival(now, known, last.sustained)
            return now, known

        return look_again

    def _clear(
        self,
        flow: Flow,
        arrival: Arrival,
        data: mujoco.MjData,
        reach: float,
        keep: Callable[[], Arrival] | None = None,
    ) -> Flight:
        """Return a flight where all contacts near are held; others are looked for up to a gap of ``reach``, m."""
        if reach <= self._near:
            return Flight(flow, arrival, self._near, -1, keep=keep)
        touch = Touch(self._detector.look(data, reach), data, self.surfaces)
        sights = further(touch, self._near, flow.start.velocity, data.qvel)
        return Flight(flow, arrival, min(sights[0].gap, reach) if sights else reach, -1, sights, keep)
