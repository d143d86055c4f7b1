"""Rigid stepping: collisions by a chosen law at located times, contact-free flow between them.

One step of duration h, from a state in which no gap is below minus the tolerance:

1. Closed contacts (gap <= tolerance) that approach collide: the law gives v+, again and again until none approaches
   (`collide.Collider`).
2. MuJoCo's integrator advances what remains of the step without contacts. The flow is shortened where bodies travel
   further than they are thick (`flow.Travel`).
3. Contacts that stay closed are held closed (`sustained`).
4. If another gap fell below minus the tolerance, the flow is repeated up to the time at which it closes, found by a
   bracketed secant on the smallest gap; then again from 1.
5. More than max_events collisions, or flows ended by a closing gap, in one step, or several flows of no length that end
   without a collision (contact points that jump): E = 0 on every closed contact, and flows for the rest of the step at
   whose end every closed contact is held (time stepping, Moreau and Jean).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.collide import Collider
from impactlaw.contacts import kinetic_metric, update_positions
from impactlaw.detection import Detector
from impactlaw.errors import OverlapError, SceneError
from impactlaw.events import ImpactEvent
from impactlaw.flow import Travel, advance, check_input, empty_state, restore_state, save_state
from impactlaw.location import Guess, locate, parabola
from impactlaw.metric import KineticMetric
from impactlaw.moment import Arrival, Flow, Moment, match
from impactlaw.plan import Plan
from impactlaw.scene import check_resolved, check_rigid
from impactlaw.sustained import hold, stays
from impactlaw.touch import Touch, look

_LOCATED = 1e-2  # part of the gap tolerance to which a closing gap is located
_SMOOTH = 0.35, 0.15  # part of its depth that a smooth gap has reached after half of the flow: a quarter, nearly
_JUMPS = 5  # flows of no length, each ended by another contact that closes without a collision: points that jump
_INSTANT = 1e-4  # part of the timestep that such a flow lasts
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


class RigidStepping:
    """The algorithm behind ``Stepper(contact_model="rigid")``; see there for the options."""

    def __init__(
        self, model: mujoco.MjModel, collider: Collider, plan: Plan, *, ignore_friction: bool, gap_tolerance: float
    ):
        if not 0 < gap_tolerance < np.inf:
            raise SceneError(f"gap_tolerance must be a positive length, got {gap_tolerance}")
        check_resolved(model, gap_tolerance)
        check_rigid(model, plan.pairs, ignore_friction=ignore_friction)
        self._model = model
        self._plan = plan
        self._collider = collider
        self._tolerance = gap_tolerance
        self._near = _NEAR * gap_tolerance
        self._detector = Detector(model, convex=plan.convex, faces=plan.faces)
        self._options = self._detector.options
        self._travel = Travel(model, plan.pairs, passing=plan.passing, turning=plan.turning)
        self._before, self._state = empty_state(model), empty_state(model)
        self._left: tuple[bytes, bytes, float] = b"", b"", 0.0
        self._next: Moment | None = None
        self._metric: KineticMetric | None = None
        self.unlocated = 0

    def step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Advance by one timestep and return the collisions; data is back where it was if an error is raised."""
        state = save_state(self._model, data, self._before)
        check_input(self._model, data, state)
        try:
            with self._options:
                return self._step(data)
        except BaseException:
            restore_state(self._model, data, state)
            update_positions(self._model, data)
            raise

    def _step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        timestep = remaining = self._options.timestep
        end = data.time + timestep
        if not (self._plan.detection or self._plan.limits):
            advance(self._model, data, self._options, timestep)
            update_positions(self._model, data)
            return ()
        if self._next is None and self._left[0] == data.qpos.tobytes() and self._glide(data, timestep):
            self._left = data.qpos.tobytes(), b"", timestep
            return ()
        events: list[ImpactEvent] = []
        start = self._begin(data, events)
        closings = jumps = 0
        while remaining > 1e-12 * timestep:
            hold_all = jumps > _JUMPS or max(len(events), closings) > self._collider.most
            before = len(events)
            changed = events or remaining < timestep
            state = save_state(self._model, data, self._state) if changed else self._before
            flight, closed = self._fly(data, state, start, remaining, hold_all=hold_all)
            closings += closed
            remaining -= flight.flow.duration
            data.time = end - remaining
            start = flight.arrival.now
            if start.collides:
                start = self._collide(data, start, events)
            if closed and len(events) == before and flight.flow.duration < _INSTANT * timestep:
                jumps += 1
        data.time = end
        self.unlocated += jumps > _JUMPS or max(len(events), closings) > self._collider.most
        self._left = data.qpos.tobytes(), data.qvel.tobytes(), timestep
        self._next = start if start.touch.pattern else None
        return tuple(events)

    def _glide(self, data: mujoco.MjData, duration: float) -> bool:
        """Advance by the whole step if no contact is near at its end; nothing is near now."""
        before = data.qvel.copy()
        advance(self._model, data, self._options, duration)
        update_positions(self._model, data)
        if self._travel.is_short(before, data.qvel, duration) and not self._detector.look(data, self._near).pattern:
            return True
        restore_state(self._model, data, self._before)
        return False

    def _begin(self, data: mujoco.MjData, events: list[ImpactEvent]) -> Moment:
        """Return the contacts of now, after collisions: those that the last step has left, if nothing has changed."""
        qpos, qvel, timestep = self._left
        same = qpos == data.qpos.tobytes()
        if same and qvel == data.qvel.tobytes() and timestep == self._options.timestep and self._next is not None:
            return self._next
        update_positions(self._model, data)
        start = self._look(data)
        if not same:
            self._refuse_overlap(start.touch)
        return self._collide(data, start, events) if start.collides else start

    def _look(self, data: mujoco.MjData, within: float = 0.0) -> Moment:
        touch = look(self._model, data, self._detector, max(self._near, within))
        return Moment.of(self._model, data, touch, tolerance=self._tolerance, timestep=self._options.timestep)

    def _refuse_overlap(self, touch: Touch) -> None:
        contacts, skin = touch.contacts, touch.pattern.skin
        depth = -contacts.gap if skin is None else -(contacts.gap + skin)
        deep = np.flatnonzero(depth > self._tolerance)
        if len(deep):
            deep = deep[np.argsort(-depth[deep])]
            units = np.where(contacts.geoms[:, 0] < 0, "beyond the limit", "m")
            named = ", ".join(f"{contacts.labels[i]} by {depth[i]:.3g} {units[i]}" for i in deep[:5])
            raise OverlapError(
                f"geoms overlap at the start of a step: {named}; move them apart (up to {self._tolerance:g} m "
                "counts as touching)"
            )

    # -- 1: collisions ---------------------------------------------------------------------------------------------

    def _collide(self, data: mujoco.MjData, start: Moment, events: list[ImpactEvent]) -> Moment:
        """Resolve the collisions of now; frames and inertia of data are those of the start."""
        closed = np.flatnonzero(start.closed)
        rounding = start.rounding[closed]
        data.qvel[:] = self._collider.collide(
            self._metric_at(data),
            start.touch.closed(closed),
            start.velocity,
            approach=rounding,
            rounding=rounding,
            time=data.time,
            qpos=data.qpos,
            events=events,
        )
        return start.moving(self._model, data)

    def _metric_at(self, data: mujoco.MjData) -> KineticMetric:
        """Return the kinetic metric of now: the last one where inertia is constant, unless somebody has changed it."""
        if self._plan.inertia or self._metric is None:
            self._metric = kinetic_metric(self._model, data)
        else:
            self._metric = kinetic_metric(self._model, data, known=self._metric)
        return self._metric

    # -- 2 to 4: flow ----------------------------------------------------------------------------------------------

    def _fly(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool
    ) -> tuple[Flight, bool]:
        """Advance from a saved state by at most ``duration``; return where that led, and whether a gap closed there."""
        flight = self._try_safely(data, state, start, duration, hold_all=hold_all)
        if hold_all or flight.gap >= -self._tolerance:
            return flight, False

        def fly(time: float, *, smooth: bool = False) -> Flight:
            restore_state(self._model, data, state)
            return self._try(data, start, time, reach=reach, smooth=smooth)

        tried, reach = flight.flow, 4.0 * abs(flight.gap) + self._near
        longest = self._travel.between(start.touch.frames, data).max()
        guess = self._guess(data, flight)
        if self._may_be_smooth(flight):
            half = fly(0.5 * tried.duration)
            if _SMOOTH[0] * flight.gap <= half.gap <= _SMOOTH[1] * flight.gap:
                held = fly(tried.duration, smooth=True)
                if held.gap >= -self._tolerance:
                    return held, False
        shortest = tried.duration * self._tolerance / max(longest, self._tolerance)
        located = locate(
            fly,
            flight,
            tried.duration,
            guess,
            target=_LOCATED * self._tolerance,
            tolerance=self._tolerance,
            shortest=shortest,
        )
        if self._was_closed(located) and located.flow.duration > 2.0 * shortest:
            # at rest over shorter flows (`sustained.stays`), not over longer ones: it rests up to there
            held = fly(located.flow.duration - 2.0 * shortest)
            return (held, True) if held.gap >= -self._tolerance else (fly(located.flow.duration), True)
        return located, True

    def _was_closed(self, end: Flight) -> bool:
        """Return whether the deepest contact penetrates and was closed, and no deeper, at the start of the flow."""
        if end.gap >= -self._tolerance:
            return False
        start, before = end.flow.start, end.arrival.known[end.deepest]
        return bool(before >= 0 and abs(start.gap[before]) <= self._tolerance)

    def _may_be_smooth(self, end: Flight) -> bool:
        """Return whether the deepest contact may continue a sustained one that was somewhere else in common faces."""
        start, touch = end.flow.start, end.arrival.now.touch
        if end.arrival.known[end.deepest] >= 0 or not touch.pattern.vague[end.deepest]:
            return False
        held = start.closed & (start.contact_velocity <= start.rounding)
        return bool((start.touch.pattern.key[held] == touch.pattern.key[end.deepest]).any())

    def _try_safely(
        self, data: mujoco.MjData, state: np.ndarray, start: Moment, duration: float, *, hold_all: bool
    ) -> Flight:
        while True:
            advance(self._model, data, self._options, duration)
            update_positions(self._model, data)
            if self._travel.is_short(start.velocity, data.qvel, duration):
                return self._arrive(data, Flow(start, duration, self._tolerance, self._travel, hold_all))
            longest = self._travel.longest_turn(start.velocity)
            if duration > longest:
                restore_state(self._model, data, state)
                duration = longest
                continue
            travel = self._travel.between(start.touch.frames, data)
            suspects = self._travel.suspects(start.touch.frames, travel)
            if len(suspects) == 0:
                return self._arrive(data, Flow(start, duration, self._tolerance, self._travel, hold_all))
            restore_state(self._model, data, state)
            update_positions(self._model, data)
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
        advance(self._model, data, self._options, duration)
        update_positions(self._model, data)
        return self._arrive(data, Flow(start, duration, self._tolerance, self._travel, hold_all, smooth), reach)

    def _arrive(self, data: mujoco.MjData, flow: Flow, reach: float = 0.0) -> Flight:
        """Look at the contacts where the flow has led, and hold those that stay closed.

        Args:
            data: at the end of the flow.
            flow: what led there.
            reach: distance to look further if nothing is near, m.
        """

        def look_again(within: float) -> tuple[Moment, np.ndarray]:
            now = self._look(data, within)
            return now, match(self._model, data, now.touch, flow)

        now, known = look_again(0.0)
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
            clear = clear - np.where(before < -self._tolerance, before, 0.0)
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
            gradient = end.arrival.now.touch.jacobian[end.deepest]
            velocity = float(gradient @ start.velocity)
            gap = end.gap - 0.5 * (velocity + float(gradient @ data.qvel)) * duration
        return parabola(max(gap, 0.0), velocity, end.gap, duration, self._tolerance)
