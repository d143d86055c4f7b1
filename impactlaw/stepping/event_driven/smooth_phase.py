"""Smooth phases between collisions: how far a phase leads, which contacts stay closed, and when another gap closes.

These are the steps 2 to 4 of `scheme`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from impactlaw.scene.detection import Detector
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.patterns import Pattern
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState, Phase, PhaseEnd, stays
from impactlaw.stepping.event_driven.location.dips import Dips
from impactlaw.stepping.event_driven.location.gap_functions import GapFunctions
from impactlaw.stepping.event_driven.location.search import locate
from impactlaw.stepping.event_driven.location.travel import Frames, Travel
from impactlaw.stepping.event_driven.location.trial_step import TrialStep
from impactlaw.stepping.event_driven.matching import Matched, continued, kept_on_faces, match, refound, runs_on
from impactlaw.stepping.event_driven.persistent_contact.frictionless import hold
from impactlaw.stepping.event_driven.persistent_contact.position import DetectAgain
from impactlaw.stepping.event_driven.persistent_contact.predicted_force import PredictedForce
from impactlaw.stepping.integration import check_speed
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.work import Work

_LOCATED = 1e-2  # part of the gap tolerance to which the closing of a gap is located
_NEAR = 1e3  # distance within which contacts are looked for, in gap tolerances
_THROWN = 2.0  # growth of the velocity in a phase, in the kinetic metric, that is due to the force that was felt


class SmoothPhases:
    """Advances from one contact state towards the end of a step.

    Attributes:
        configuration: the configuration of the scene, which is advanced.
        tolerance: the gap tolerance, m.
        farthest: the attribute of `Travel`.
        pairs: number of pairs of geoms that can meet.
        work: the counter of work, as given.
        options: a context to be entered (``with``) around every use.
        surfaces: surfaces that move by themselves; None if the scene has none.
    """

    def __init__(self, model: mujoco.MjModel, plan: Plan, gap_tolerance: float, work: Work, *, exact: bool):
        self._model = model
        self.tolerance = gap_tolerance
        self._near = _NEAR * gap_tolerance
        self.surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces else None
        what = {"convex": plan.convex, "faces": plan.faces, "friction": plan.friction, "surfaces": self.surfaces}
        self._detector = Detector(model, **what)
        self._exact = exact
        self.work = work
        self._travel = Travel(model, plan.pairs, self.surfaces, passing=plan.passing, turning=plan.turning)
        self._passing, self.pairs = plan.passing, len(plan.pairs.geoms)
        self.farthest = self._travel.farthest
        self.options = self._detector.options
        self.configuration = Configuration(model, self.options, self.surfaces)
        self._dips = Dips(self.configuration, self._detector, self._travel, near=self._near, tolerance=gap_tolerance)

    @property
    def is_steady(self) -> bool:
        """Whether no surface moves by itself in this step, and no belt runs, which the model may start or stop."""
        return self.surfaces is None or (self.surfaces.still and not self.surfaces.run)

    def learn_friction(self) -> None:
        """Read the friction of the model again."""
        self._detector.patterns.forget()

    def advance(self, duration: float, force: np.ndarray | None = None, *, still: bool = False) -> None:
        """Integrate for ``duration`` s without contacts, or with their force applied, see `ContactState.force`.

        Where everything is ``still``, torques of `body_axes` are along those axes.
        """
        data = self.configuration.data
        if self.surfaces is not None:
            self.surfaces.aim(data)
        own = None if force is None else (data.qfrc_applied.copy(), data.xfrc_applied.copy())
        try:
            if force is not None and still:
                data.qfrc_applied += force
            elif force is not None:
                self.configuration.body_axes.apply(data, force)
            self.options.integrate(duration)
            mujoco.mj_step(self._model, data)
        finally:
            if own is not None:
                data.qfrc_applied[:], data.xfrc_applied[:] = own
        check_speed(data)
        self.configuration.end_phase(duration)

    def look(self, within: float = 0.0) -> ContactState:
        """Return all current contacts with a gap up to ``within``, m or rad, and how they move."""
        configuration = self.configuration
        configuration.refresh()
        found = self._detector.look(configuration.data, max(self._near, within))
        configuration.comply(found.stiffness)
        found = ContactSet(found, configuration)
        return ContactState.of(found, tolerance=self.tolerance, timestep=self.options.timestep)

    def leave_contacts(self, pattern: Pattern) -> None:
        """Fill data.contact as `look` does, for a known pattern, without reading the contacts; frames are current."""
        self._detector.refresh(self.configuration.data, self._near, pattern)

    def frames(self) -> Frames | None:
        """Return the current frames of all geoms; None if no body can pass through another."""
        return Frames.of(self.configuration.data) if self._passing else None

    def stay_apart(self, start: Frames | None = None) -> bool:
        """Advance by a whole timestep, starting without near contacts; return whether no contact came near meanwhile.

        Without frames at the start, the answer is derived from velocities only.
        """
        before = self.configuration.data.qvel.copy()
        return self._try_timestep(before, start) and self._dips.is_clear(start, before, self.options.timestep)

    def stay_together(self, pattern: Pattern, start: Frames | None = None) -> bool:
        """Advance by a whole timestep with closed contacts; return whether all are still closed, uncorrected."""
        before, gaps = self.configuration.data.qvel.copy(), (-CORRECTED * self.tolerance, self.tolerance)
        if not self._try_timestep(before, start):
            return False
        return self._dips.are_together(pattern, start, before, self.options.timestep, gaps)

    def _try_timestep(self, before: np.ndarray, start: Frames | None) -> bool:
        """Advance by a timestep; return whether no body can have passed through another meanwhile.

        Without frames at the start, this is derived from velocities only.
        """
        data, timestep = self.configuration.data, self.options.timestep
        self.advance(timestep)
        short = self._travel.is_short(before, data.qvel, timestep)
        return short or (start is not None and self._travel.is_safe(start, before, data, timestep))

    def advance_to_contact(
        self, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool
    ) -> tuple[TrialStep, bool]:
        """Advance from a saved state by at most ``duration``; return the trial, and whether a gap closed at its end.

        If the contact forces of the last phase have thrown the bodies, that is repeated without them.
        """
        found = self._advance_to_contact(state, start, duration, hold_all=hold_all)
        if start.force is not None and self._is_thrown(start.velocity, found[0].duration):
            self.configuration.restore(state)
            start = start._replace(force=None)
            return self._advance_to_contact(state, start, duration, hold_all=hold_all)
        return found

    def _is_thrown(self, before: np.ndarray, duration: float) -> bool:
        """Return whether bodies have become so much faster in a phase that the force they felt must have done it.

        Next to bodies a thousand times as heavy, an error of that force grows from step to step until it throws light
        links. Others that have become so fast, as from rest, lose only accuracy if the phase is repeated without it.
        """
        norm = self.configuration.kinetic_norm
        faster = norm(self.configuration.data.qvel) - _THROWN * norm(before)
        if faster <= 0.0:
            return False
        mass = float(self._model.body_mass.sum())
        return faster > _THROWN * duration * mujoco.mju_norm(self._model.opt.gravity) * math.sqrt(mass)

    def _advance_to_contact(
        self, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool
    ) -> tuple[TrialStep, bool]:
        trial, closed = self._try_safely(state, start, duration, hold_all=hold_all), False
        if hold_all:
            return trial.kept(), closed
        if trial.gap < -self.tolerance:
            trial, closed = self._locate(state, trial, start)
        while (shorter := self._dips.find(trial, state, self._again(state, trial.phase))) is not None:
            trial, closed = self._locate(state, shorter, start)
        return trial.kept(), closed

    def _again(self, state: np.ndarray, phase: Phase) -> Callable[..., TrialStep]:
        """Return a function that repeats a phase for another duration, s; see `_arrive`."""

        def again(time: float, *, smooth: bool = phase.smooth) -> TrialStep:
            self.configuration.restore(state)
            self.work.integrate()
            self.advance(time, phase.start.force)
            return self._arrive(state, phase._replace(duration=time, smooth=smooth))

        return again

    def _locate(self, state: np.ndarray, trial: TrialStep, begun: ContactState) -> tuple[TrialStep, bool]:
        """Return the trial up to the first gap that closes, given a longer one, and whether a gap closes.

        Where a contact only runs along a rim, the trial has lost no contact, and it is repeated with the forces of
        ``begun``.
        """
        start, tried = trial.phase.start, trial.phase._replace(smooth=False)
        again = self._again(state, tried)
        travel = self._travel.between(start.frames, self.configuration.data)
        pair = self._continued(trial, again)
        if pair is not None:
            held = self._again(state, tried._replace(start=begun))(tried.duration, smooth=True)
            if held.gap >= -self.tolerance:
                return held, False
            if held.phase_end.now.pattern.key[held.deepest] != pair:  # another gap has closed
                trial, start, again = held, held.phase.start, self._again(state, held.phase)
        shortest = tried.duration * self.tolerance / max(*travel.tolist(), -trial.gap, self.tolerance)
        gap_functions = GapFunctions(start.gap, start.contact_velocity, exact=self.configuration.is_rk4)
        gap_functions.add(trial.duration, trial.observations)
        located = locate(
            again, trial, gap_functions, target=_LOCATED * self.tolerance, tolerance=self.tolerance, shortest=shortest
        )
        if located.was_closed and located.duration > 2.0 * shortest:
            # at rest over shorter phases (`stays`), but not over longer ones: hold the contact up to there
            held = again(located.duration - 2.0 * shortest)
            return (held, True) if held.gap >= -self.tolerance else (again(located.duration), True)
        return located, True

    def _continued(self, trial: TrialStep, again: Callable[[float], TrialStep]) -> int | None:
        """Return the key of a pair of which a contact continues one that was closed at the start, in another place.

        Of the open gaps that are negative at the end, the deepest that may do so is looked at; None if it does not. Two
        earlier times show whether its gap has bent smoothly. One alone does not distinguish it from the gap of another
        edge, which was open and falls at constant speed.
        """
        end, gap = trial.phase_end, trial.phase_end.now.gap
        deep = np.flatnonzero((end.known < 0) & end.now.pattern.vague & (gap < -self.tolerance))
        for one in deep[gap[deep].argsort()].tolist():
            begun = continued(end, trial.phase, one, gap.item(one))
            if begun is None:
                continue
            pair, half = int(end.now.pattern.key[one]), again(0.5 * trial.duration)
            if runs_on(half.phase_end, end, trial.phase, one):
                return pair
            middle = half.least_gap(pair)
            if not begun.is_smooth(middle):
                return None
            return pair if begun.to_half(middle).is_smooth(again(0.25 * trial.duration).least_gap(pair)) else None
        return None

    def _try_safely(self, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool) -> TrialStep:
        """Advance by at most ``duration`` from a saved state, so that no body passes through another."""
        configuration = self.configuration
        while True:
            self.work.integrate()
            self.advance(duration, start.force)
            if self._travel.is_short(start.velocity, configuration.data.qvel, duration):
                break
            longest = self._travel.longest_turn(start.velocity)
            if duration > longest:
                configuration.restore(state)
                duration = longest
                continue
            suspects, moved = self._travel.suspects(start.frames, configuration.data)
            if len(suspects) == 0:
                break
            configuration.restore(state)
            configuration.update()
            self.work.look(len(suspects))
            fraction = self._travel.safe_fraction(configuration.data, suspects, moved)
            if fraction >= 1.0:
                self.advance(duration, start.force)
                break
            duration *= 0.9 * fraction
        phase = Phase(start, duration, self.tolerance, self._travel, self.work, hold_all, exact=self._exact)
        return self._arrive(state, phase)

    def _arrive(self, state: np.ndarray, phase: Phase) -> TrialStep:
        """Look at the contacts at the end of the phase, and hold those that stay closed.

        If contacts whose force the phase has felt are lost, the phase is repeated without that force.
        """
        found = self._match(phase)
        if found is None:
            return self._again(state, phase._replace(start=phase.start._replace(force=None)))(phase.duration)
        now, known = found
        phase_end, keep = PhaseEnd(now, known, stays(now.gap, known, phase)), None
        held = phase_end.sustained if phase.start.force is not None else phase_end.sustained & now.closed
        if np.count_nonzero(held):
            phase_end, keep = hold(phase_end, phase, self._look_again(phase, phase_end))
        return TrialStep.of(phase, phase_end, keep, self._near)

    def _look_and_match(self, phase: Phase, within: float = 0.0) -> Matched:
        now = self.look(within)
        return Matched(now, match(now.contact_set, phase))

    def _match(self, phase: Phase) -> Matched | None:
        """Return the contacts at the end of the phase, matched with those at its start; see `match`.

        Contacts whose force the phase has felt are looked for as far as that force can have moved them. Return None if
        they are lost.
        """
        found, start = self._look_and_match(phase), phase.start
        self.work.look(len(found.known))
        if start.force is None or start.active is None:
            return found
        active = start.active.nonzero()[0]
        if found.continues(active):
            return found
        shift = PredictedForce.of(self.configuration, start.force, phase.duration).shift
        found = self._look_and_match(phase, start.contact_set.opening(shift))
        return found if found.continues(active) else None

    def _look_again(self, phase: Phase, phase_end: PhaseEnd) -> DetectAgain:
        """Return a function that looks at current contacts up to a gap, m, and matches them with the start.

        If the same pairs of geoms are near as before, with one contact each, the contacts are the same.
        """
        before, held = Matched(phase_end.now, phase_end.known), phase_end.known[phase_end.sustained]

        def detect_again(within: float) -> Matched:
            nonlocal before
            now, known = self.look(within), before.known
            self.work.look(len(now.gap))
            if now.pattern is not before.now.pattern or not now.pattern.distinct:
                known = refound(match(now.contact_set, phase), held, now.contact_set, phase)
                known = kept_on_faces(Matched(now, known), before, held, phase.tolerance)
            before = Matched(now, known)
            return before

        return detect_again
