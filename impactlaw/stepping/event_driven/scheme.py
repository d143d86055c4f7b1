"""Rigid stepping: collisions by a chosen law at located times, and smooth phases between them.

A step whose contacts need no more than one look is taken by a shortcut (`last_step`). Any other step of duration h
starts from a state in which no gap is below minus the tolerance (`overlap`):

1. Closed contacts (gap <= tolerance) that approach collide. The law gives v+, and is applied again until no closed
   contact approaches (`collisions.Collider`).
2. MuJoCo's integrator advances the rest of the step without contacts. This smooth phase is shortened if bodies travel
   further than they are thick (`travel.Travel`).
3. Contacts that stay closed are held closed (`persistent_contact`).
4. If another gap fell below minus the tolerance, the phase is repeated up to the time at which that gap closes, found
   by a bracketed search on the smallest gap; then the step continues at 1. The same is done for a gap that was negative
   only within the phase (`location.dips`). Steps 2 to 4 are in `smooth_phase`. A gap that has jumped below minus the
   tolerance, as between points of faces, is opened by the smallest shift (`overlap.push_out`).
5. After more than max_events collisions in one step, E = 0 is applied to every closed contact, and the rest of the step
   is taken in phases that hold every contact that is closed at their end. This ends a collapse, that is, a sequence of
   ever smaller collisions.

Time stepping takes the rest of the step instead (`rest_of_step`), starting with the last phase, if E = 0 would cost
energy or contact is not held (`left_to_time_stepping`), no impulses are certified, contact points jump, or the step
takes too much work (`work`). It takes the whole step if the reason is the number of collisions, since the energy amid
them may be distributed in any way.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, OverlapError, SolverError, UnfinishedStepError, UnsolvableLawError
from impactlaw.laws import Law
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.contacts import update_positions
from impactlaw.solvers.one_thread import one_thread
from impactlaw.stepping.collisions import Collider, kinetic_metric
from impactlaw.stepping.compatibility import OVERRIDE, check_override, check_resolved, check_rigid
from impactlaw.stepping.event_driven.contact_state import ContactState
from impactlaw.stepping.event_driven.last_step import LastStep
from impactlaw.stepping.event_driven.left_to_time_stepping import (
    are_bodies_tied,
    check_calm,
    check_driven,
    check_ended,
    check_held,
)
from impactlaw.stepping.event_driven.overlap import open_jump, overlaps, push_out, refuse
from impactlaw.stepping.event_driven.rest_of_step import RestOfStep
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases
from impactlaw.stepping.impact_event import ImpactEvent, LazyEvents, together
from impactlaw.stepping.integration import check_finite, check_timestep, empty_state, no_room
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.work import Work

_JUMPS = 5  # phases of almost no length, each ended by a contact that closes without a collision: points jump
_INSTANT = 1e-4  # part of the timestep below which a phase counts as such
_WORK = 120  # number of units that a step may take at least, whatever max_events is
_OPENING = 0.15  # part of the work of a step that opening slight overlaps may take
_SLIGHT = 1e6  # largest overlap left by time stepping that is opened at once, in gap tolerances
_MANY = 0.5  # part of max_events above which collisions count as many, if the step cannot be finished
_FEW = 20  # degrees of freedom below which linear algebra starts no threads
_UNFINISHED = DivergenceError, SolverError, UnfinishedStepError, UnsolvableLawError, np.linalg.LinAlgError


class RigidStepping:
    """The algorithm behind ``Stepper(contact_model="rigid")``; see there for the options.

    Attributes:
        unlocated: number of steps so far that time stepping, or E = 0 after max_events collisions, has finished.
        crowded: whether the number of collisions was the reason for one of them.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        collider: Collider,
        plan: Plan,
        *,
        exact: bool,
        gap_tolerance: float,
        push_out: bool = False,
        rest: RestOfStep | None = None,
    ):
        check_resolved(model, gap_tolerance)
        check_rigid(model)
        self._model = model
        self._plan = plan
        self._collider = collider
        self._tolerance = gap_tolerance
        self._push_out = push_out
        self._rest = rest
        self._work = Work(model.nv, max(_WORK, collider.most), convex=plan.convex)
        self._phases = SmoothPhases(model, plan, gap_tolerance, self._work, exact=exact)
        self._options, self._surfaces = self._phases.options, self._phases.surfaces
        self._configuration = self._phases.configuration
        self._before, self._state = empty_state(model), empty_state(model)
        self._last = LastStep(self._phases, plan)
        self._metric: KineticMetric | None = None
        self._begun = self._before, 0.0, 0  # start of a phase: saved state, rest of the step, s, collisions so far
        self.unlocated, self.crowded = 0, False

    @property
    def short_steps(self) -> int:
        """Number of time-stepped steps that have not met the law, see `time_stepping.scheme.TimeStepping`."""
        return 0 if self._rest is None else self._rest.short_steps

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self._collider = replace(self._collider, law=law)
        if self._rest is not None:
            self._rest.set_law(law)

    def learn_friction(self) -> None:
        """Read the friction of the model again, and forget contacts and forces of the last step."""
        self._last.forget()
        self._phases.learn_friction()

    def step(self, data: mujoco.MjData) -> LazyEvents:
        """Advance by one timestep and return the collisions; if an error is raised, data is as it was before."""
        self._configuration.bind(data)
        state, events = self._configuration.save(self._before), []
        surfaces = self._surfaces
        motion = None if surfaces is None else surfaces.last_motion
        check_finite(data, state)
        waits = self._rest is not None and self._rest.waits(self._last)
        try:
            try:
                with self._options:
                    return self._step(data, events, waits=waits)
            except _UNFINISHED as error:
                if self._rest is None:
                    raise
                if not waits:
                    self._rest.failed()
                    if len(events) > _MANY * self._collider.most:  # the order of so many is a matter of rounding
                        self.crowded = True
                        self._begun = state, self._options.timestep, 0
                return self._finish(data, self._rest, events, opens=not isinstance(error.__cause__, mujoco.FatalError))
        except BaseException:
            if surfaces is not None and motion is not None:
                surfaces.go_on(motion)
            self._configuration.restore(state)
            update_positions(self._model, data)  # surfaces stay where they were put
            raise

    def _finish(self, data: mujoco.MjData, rest: RestOfStep, events: list[ImpactEvent], *, opens: bool) -> LazyEvents:
        """Take the rest of the step by time stepping."""
        state, remaining, count = self._begun
        known = tuple(events[:count])
        self._configuration.restore(state)
        end = data.time + remaining
        more = rest.take(data, remaining, self._surfaces)
        data.time = end
        if opens:
            self._open()
        if self._surfaces is not None:
            self._surfaces.end(data)
        self.unlocated += 1
        self._last.end_otherwise()
        return together([known, more]) if callable(more) else known

    def _open(self) -> None:
        """Open the slight overlaps that time stepping has left; it opens the others over time."""
        self._work.begin(_OPENING)
        with self._options:
            self._configuration.update()
            now = self._phases.look()
            slight = overlaps(now.contact_set, self._tolerance) and now.gap.min() >= -_SLIGHT * self._tolerance
            if slight and not are_bodies_tied(now):
                open_jump(self._phases, now)

    def _step(self, data: mujoco.MjData, events: list[ImpactEvent], *, waits: bool) -> LazyEvents:
        timestep = self._options.timestep
        check_timestep(timestep)
        if self._options.enabled & OVERRIDE:
            check_override(self._model, self._plan)
        end = data.time + timestep
        self._begun = self._before, timestep, 0
        self._work.begin()
        if not (self._plan.detection or self._plan.limits):
            self._phases.advance(timestep)
            return ()
        if self._surfaces is not None:
            self._surfaces.begin(data, timestep)
        if self._last.take_shortcut(self._before):
            return ()
        if waits:
            raise UnfinishedStepError("the step before was not finished")
        try:
            with nullcontext() if self._model.nv < _FEW else one_thread():
                start = self._take(events)
        except mujoco.FatalError as error:
            raise no_room(data, error) from error
        data.time = end
        if self._surfaces is not None:
            self._surfaces.end(data)
        self.unlocated += len(events) > self._collider.most
        if self._rest is not None:
            self._rest.succeeded()
        self._last.end(self._before, start, collided=bool(events))
        return tuple(events)

    def _take(self, events: list[ImpactEvent]) -> ContactState:
        """Advance from collision to collision by a timestep; return the contacts then."""
        configuration, timestep = self._configuration, self._options.timestep
        remaining = timestep
        start = self._begin(events)
        closings = jumps = 0
        while remaining > 1e-12 * timestep:
            hold_all = jumps > _JUMPS or max(len(events), closings) > self._collider.most
            before = len(events)
            state = configuration.save(self._state)
            self._begun = state, remaining, before
            trial, closed = self._phases.advance_to_contact(state, start, remaining, hold_all=hold_all)
            closings += closed
            remaining -= trial.duration
            start = trial.phase_end.now
            if closed and trial.gap < -self._tolerance:  # a gap has jumped
                start = open_jump(self._phases, start)
            self._check_held(start)
            if start.collides:
                start = self._collide(start, events)
            if closed and len(events) == before and trial.duration < _INSTANT * timestep:
                jumps += 1
        self.unlocated += jumps > _JUMPS or closings > self._collider.most >= len(events)
        return start

    def _begin(self, events: list[ImpactEvent]) -> ContactState:
        """Return the contacts at the start, after collisions.

        If nothing has changed since the last step, these are the contacts at its end.
        """
        known = self._last.contacts()
        if known is not None:
            return known
        start = self._phases.look()
        if not self._last.is_here() and overlaps(start.contact_set, self._tolerance):
            if not self._push_out:
                reason = f"move them apart (up to {self._tolerance:g} m counts as touching), or let "
                reason += 'overlap="push-out", or scheme="time-stepping", do it'
                raise refuse(start.contact_set, self._tolerance, reason)
            start = self._pushed_out(start)
        self._check_held(start)
        return self._collide(start, events) if start.collides else start

    def _pushed_out(self, start: ContactState) -> ContactState:
        """Push out overlaps that were set from outside; time stepping opens bodies that are squeezed."""
        try:
            return push_out(self._phases, start)
        except OverlapError as squeezed:
            if self._rest is None:
                raise
            raise UnfinishedStepError(str(squeezed)) from None

    def _check_held(self, state: ContactState) -> None:
        """Raise `UnfinishedStepError` if contact is not held, or cannot be beside equality constraints."""
        if self._rest is not None and are_bodies_tied(state):
            raise UnfinishedStepError('equality constraints tie bodies that touch; scheme="time-stepping" leaves them')
        check_held(state, self._options.timestep, self._tolerance)

    def _collide(self, start: ContactState, events: list[ImpactEvent]) -> ContactState:
        """Resolve the collisions at this time."""
        data, before = self._configuration.data, len(events)
        closed, metric = start.contact_set.closed(start.closed.nonzero()[0]), self._metric_now()
        rounding = start.rounding_by(metric, closed)
        if self._rest is not None:
            check_calm(start, closed, rounding)
        data.qvel[:] = self._collider.collide(
            metric,
            closed,
            start.velocity,
            approach=rounding,
            rounding=rounding,
            time=data.time,
            qpos=data.qpos,
            events=events,
            work=self._work,
        )
        if self._rest is not None:
            check_driven(events[before:])
            if len(events) > self._collider.most:
                check_ended(events[-1], self._options.timestep, data.qacc)
        return start.moving()

    def _metric_now(self) -> KineticMetric:
        """Return the current kinetic metric: the last one if inertia is constant, unless the model was changed."""
        self._configuration.refresh()
        known = None if self._plan.inertia else self._metric
        self._metric = kinetic_metric(self._model, self._configuration.data, known=known)
        return self._metric
