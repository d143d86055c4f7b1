"""Rigid stepping: collisions by a chosen law at located times, contact-free flow between them.

One step of duration h, from a state in which no gap is below minus the tolerance:

1. Closed contacts (gap <= tolerance) that approach collide (`collide.Collider`).
2. MuJoCo's integrator advances what remains of the step without contacts. The flow is shortened where bodies travel
   further than they are thick (`flow.Travel`).
3. Contacts that stay closed are held closed (`sustained`).
4. If another gap fell below minus the tolerance, the flow is repeated up to the time at which it closes, found by a
   bracketed secant on the smallest gap; then again from 1.
5. More than max_events collisions in one step: E = 0 on every closed contact, and one flow for the rest of the step
   at the end of which every closed contact is held (time stepping, Moreau and Jean).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.collide import Collider
from impactlaw.contacts import Contacts, detect, gap_gradients, geom_names, kinetic_metric, update_positions
from impactlaw.errors import OverlapError
from impactlaw.events import ImpactEvent
from impactlaw.flow import Frames, Travel, advance, restore_state, save_state
from impactlaw.location import Guess, locate, parabola
from impactlaw.metric import KineticMetric
from impactlaw.scene import check_rigid, geom_pairs
from impactlaw.sustained import Matches, Start, hold, match, stays

_ROUNDING = 1e-13  # of a contact velocity in the kinetic metric, relative to the velocity of the whole scene
_STILL = 1e-3  # part of the gap tolerance that a velocity must cross in a timestep to be one
_LOCATED = 1e-2  # part of the gap tolerance to which a closing gap is located


@dataclass(frozen=True, eq=False)
class Flight:
    """A flow that has been tried: its duration, the contacts at its end, and those that were not there before."""

    duration: float
    contacts: Contacts
    matches: Matches
    opened: np.ndarray  # contacts that are not held, bool (h,)
    gap: float  # smallest gap among them, m


class RigidStepping:
    """The algorithm behind ``Stepper(contact_model="rigid")``; see there for the options."""

    def __init__(
        self,
        model: mujoco.MjModel,
        collider: Collider,
        *,
        ignore_friction: bool,
        gap_tolerance: float,
    ):
        pairs = geom_pairs(model)
        check_rigid(model, pairs, ignore_friction=ignore_friction)
        self._model = model
        self._collider = collider
        self._tolerance = gap_tolerance
        self._names = geom_names(model)
        self._travel = Travel(model, pairs)
        self._left_at = np.full(model.nq, np.nan)
        self.unlocated = 0

    def step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Advance by one timestep and return the collisions; an error leaves data as it was."""
        state = save_state(self._model, data)
        try:
            return self._step(data)
        except BaseException:
            restore_state(self._model, data, state)
            raise

    def _step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        model = self._model
        timestep = remaining = model.opt.timestep
        end = data.time + timestep
        update_positions(model, data)
        contacts = self._detect(data, 1e3 * self._tolerance)
        if not np.array_equal(data.qpos, self._left_at):
            self._refuse_overlap(contacts)
        events: list[ImpactEvent] = []
        flights = 0
        while True:
            self._collide(data, contacts, events)
            if remaining <= 1e-12 * timestep:
                break
            start = self._start(data, contacts)
            flights += 1
            if max(len(events), flights) > self._collider.most:
                self.unlocated += 1
                flight = self._try(data, start, remaining, hold_all=True)
            else:
                flight = self._fly(data, start, remaining)
            contacts = flight.contacts
            remaining -= flight.duration
            data.time = end - remaining
        data.time = end
        self._left_at = data.qpos.copy()
        return tuple(events)

    def _detect(self, data: mujoco.MjData, within: float) -> Contacts:
        return detect(self._model, data, within, self._names)

    def _refuse_overlap(self, contacts: Contacts) -> None:
        deep = np.flatnonzero(contacts.gap < -self._tolerance)
        if len(deep):
            deep = deep[np.argsort(contacts.gap[deep])]
            named = ", ".join(f"{contacts.labels[i]} by {-contacts.gap[i]:.3g} m" for i in deep[:5])
            raise OverlapError(
                f"geoms overlap at the start of a step: {named}; move them apart (a gap down to -{self._tolerance:g} m "
                "counts as touching)"
            )

    # -- 1: collisions ---------------------------------------------------------------------------------------------

    def _rounding(self, metric: KineticMetric, J: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Contact velocities, m/s, (h,), below which there is no telling motion from rounding."""
        lengths = np.linalg.norm(metric.whiten_gradients(J), axis=1)
        still = _STILL * self._tolerance / self._model.opt.timestep
        return np.maximum(_ROUNDING * metric.norm(velocity) * lengths, still)

    def _collide(self, data: mujoco.MjData, contacts: Contacts, events: list[ImpactEvent]) -> None:
        contacts = contacts.select(contacts.gap <= self._tolerance)
        if len(contacts) == 0:
            return
        J = gap_gradients(self._model, data, contacts)
        if not (J @ data.qvel < 0).any():
            return
        metric = kinetic_metric(self._model, data)
        rounding = self._rounding(metric, J, data.qvel)
        data.qvel[:] = self._collider.collide(
            metric,
            J,
            contacts,
            data.qvel.copy(),
            approach=rounding,
            rounding=rounding,
            time=data.time,
            qpos=data.qpos,
            events=events,
        )

    # -- 2 to 4: flow ----------------------------------------------------------------------------------------------

    def _start(self, data: mujoco.MjData, contacts: Contacts) -> Start:
        J = gap_gradients(self._model, data, contacts)
        if len(contacts) == 0:
            return Start(contacts, Frames.of(data), J, np.zeros(0), np.zeros(0), data.qvel.copy())
        rounding = self._rounding(kinetic_metric(self._model, data), J, data.qvel)
        return Start(contacts, Frames.of(data), J, J @ data.qvel, rounding, data.qvel.copy())

    def _fly(self, data: mujoco.MjData, start: Start, duration: float) -> Flight:
        state = save_state(self._model, data)
        duration = min(duration, self._travel.longest_turn(data))
        flight, duration = self._try_safely(data, state, start, duration)
        if flight.gap >= -self._tolerance:
            return flight

        def fly(time: float) -> Flight:
            restore_state(self._model, data, state)
            return self._try(data, start, time)

        return locate(
            fly,
            flight,
            duration,
            self._guess(data, start, flight),
            target=_LOCATED * self._tolerance,
            tolerance=self._tolerance,
        )

    def _try_safely(
        self, data: mujoco.MjData, state: np.ndarray, start: Start, duration: float
    ) -> tuple[Flight, float]:
        while True:
            advance(self._model, data, duration)
            update_positions(self._model, data)
            travel = self._travel.between(start.frames, data)
            suspects = self._travel.suspects(start.frames, travel)
            if len(suspects) == 0:
                return self._arrive(data, start, duration, travel), duration
            restore_state(self._model, data, state)
            update_positions(self._model, data)
            fraction = self._travel.safe_fraction(data, suspects, travel)
            if fraction >= 1.0:
                return self._try(data, start, duration), duration
            duration *= 0.9 * fraction

    def _try(self, data: mujoco.MjData, start: Start, duration: float, *, hold_all: bool = False) -> Flight:
        advance(self._model, data, duration)
        update_positions(self._model, data)
        return self._arrive(data, start, duration, self._travel.between(start.frames, data), hold_all=hold_all)

    def _arrive(
        self, data: mujoco.MjData, start: Start, duration: float, travel: np.ndarray, *, hold_all: bool = False
    ) -> Flight:
        """Look at the contacts where the flow has led, and hold those that stay closed."""
        tolerance = self._tolerance
        within = 4.0 * travel.max(initial=0.0) + 1e3 * tolerance

        def look() -> tuple[Contacts, np.ndarray]:
            contacts = self._detect(data, within)
            return contacts, match(contacts, start, data, travel, tolerance)

        contacts, known = look()
        closed = contacts.gap <= tolerance
        matches = Matches(known, closed if hold_all else stays(contacts.gap, known, start, duration, tolerance))
        if (matches.sustained & closed).any():
            contacts, matches = hold(self._model, data, contacts, matches, start, duration, tolerance, look)
        opened = ~matches.sustained
        return Flight(duration, contacts, matches, opened, float(contacts.gap[opened].min(initial=within)))

    def _guess(self, data: mujoco.MjData, start: Start, end: Flight) -> Guess:
        """Guess when the deepest contact that is not held has closed."""
        deepest = int(np.argmin(np.where(end.opened, end.contacts.gap, np.inf)))
        gap, before = float(end.contacts.gap[deepest]), end.matches.start[deepest]
        if before >= 0:
            gap0, velocity0 = float(start.contacts.gap[before]), float(start.contact_velocity[before])
            return parabola(gap0, velocity0, gap, end.duration, self._tolerance)
        # not seen at the start: take the gap there from the contact velocities of both ends
        J = gap_gradients(self._model, data, end.contacts.select(np.array([deepest])))[0]
        velocity0, velocity1 = float(J @ start.velocity), float(J @ data.qvel)
        gap0 = gap - 0.5 * (velocity0 + velocity1) * end.duration
        return parabola(max(gap0, self._tolerance), velocity0, gap, end.duration, self._tolerance)
