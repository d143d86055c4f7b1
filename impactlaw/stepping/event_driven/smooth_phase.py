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
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState, Phase, PhaseEnd, stays
from impactlaw.stepping.event_driven.event_location import locate
from impactlaw.stepping.event_driven.gap_functions import GapFunctions
from impactlaw.stepping.event_driven.matching import continued, match, refound, runs_on
from impactlaw.stepping.event_driven.persistent_contact.felt_force import FeltForce, applied
from impactlaw.stepping.event_driven.persistent_contact.frictionless import hold
from impactlaw.stepping.event_driven.travel import Frames, Travel
from impactlaw.stepping.event_driven.trial_step import TrialStep, expected, further, rests
from impactlaw.stepping.integration import advance, restore_state
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.work import Work

_LOCATED = 1e-2  # part of the gap tolerance to which a closing gap is located
_SMOOTH = 0.1  # part of its bent depth by which a smooth gap may miss a quarter of it after half of the flow
_NEAR = 1e3  # gap tolerances within which contacts are looked for
_AHEAD = 3  # flows at most up to where a gap is expected to close, before one over all that remains
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


class SmoothPhases:
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

    def look(self, data: mujoco.MjData, within: float = 0.0) -> ContactState:
        """Return the contacts of now, of a gap up to ``within``, m or rad, at least; frames must be current."""
        contact_set = ContactSet(self._detector.look(data, max(self._near, within)), data, self.surfaces)
        return ContactState.of(self._model, data, contact_set, tolerance=self.tolerance, timestep=self.options.timestep)

    def _look_at_places(self, data: mujoco.MjData, within: float) -> ContactState:
        """Return the contacts as `look` does, without their motion."""
        contact_set = ContactSet(self._detector.look(data, max(self._near, within)), data, self.surfaces)
        return ContactState.without_motion(contact_set, tolerance=self.tolerance, timestep=self.options.timestep)

    def refresh(self, data: mujoco.MjData, pattern: Pattern) -> None:
        """Leave in data.contact what `look` leaves there where the pattern is known, and read nothing."""
        self._detector.refresh(data, self._near, pattern)

    def frames(self, data: mujoco.MjData) -> Frames | None:
        """Return the frames of all geoms of now; None if no body can pass through another."""
        return Frames.of(data) if self._passing else None

    def try_timestep(self, data: mujoco.MjData, start: Frames | None = None) -> bool:
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

    def advance_to_contact(
        self, data: mujoco.MjData, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool
    ) -> tuple[TrialStep, bool]:
        """Advance from a saved state by at most ``duration``; return where that led, and whether a gap closed there."""
        trial_step, closed = self._advance_to_contact(data, state, start, duration, hold_all=hold_all)
        return trial_step.kept(), closed

    def _advance_to_contact(
        self, data: mujoco.MjData, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool
    ) -> tuple[TrialStep, bool]:
        """Fly, and leave data at the end of the flight returned."""
        if hold_all:
            return self._try_safely(data, state, start, duration, hold_all=True), False
        gap_functions, time = None, expected(start, self.tolerance)
        if time < duration:
            gap_functions = self._gap_functions(start)
            trial_step = self._try_ahead(data, state, start, (time, duration), gap_functions)
            if trial_step is not None:
                located = trial_step.gap >= -_LOCATED * self.tolerance
                return (trial_step, True) if located else self._locate(data, state, trial_step, gap_functions)
        trial_step = self._try_safely(data, state, start, duration)
        if trial_step.gap >= -self.tolerance:
            return trial_step, False
        gap_functions = self._gap_functions(start) if gap_functions is None else gap_functions
        gap_functions.add(trial_step.duration, trial_step.observations)
        return self._locate(data, state, trial_step, gap_functions)

    def _try_ahead(
        self,
        data: mujoco.MjData,
        state: np.ndarray,
        start: ContactState,
        times: tuple[float, float],
        gap_functions: GapFunctions,
    ) -> TrialStep | None:
        """Fly up to where a gap is expected to close; return that flight if one has closed there or before.

        Otherwise data is at the start again.

        Args:
            data: the state.
            state: the same, saved.
            start: contacts at the start.
            times: at which a gap is expected to close, and up to which one is looked for, s.
            gap_functions: to add what the flights have shown.
        """
        time, last = times
        for _ in range(_AHEAD):
            trial_step = self._try_safely(data, state, start, time)
            gap_functions.add(trial_step.duration, trial_step.observations)
            if abs(trial_step.gap) > _LOCATED * self.tolerance:
                if trial_step.gap < 0:
                    return trial_step
            elif gap_functions.falls(trial_step.duration):
                return trial_step
            restore_state(self._model, data, state)
            time = gap_functions.ahead(trial_step.duration)
            if time >= last:
                break
        self.update(data)
        return None

    def _gap_functions(self, start: ContactState) -> GapFunctions:
        return GapFunctions(start.gap, start.contact_velocity, exact=self._model.opt.integrator == _RK4)

    def _locate(
        self, data: mujoco.MjData, state: np.ndarray, trial_step: TrialStep, gap_functions: GapFunctions
    ) -> tuple[TrialStep, bool]:
        """Return the flight up to the first gap that closes, where one has closed after a longer one, and whether."""
        start, tried = trial_step.phase.start, trial_step.phase
        reach = 4.0 * abs(trial_step.gap) + self._near

        def again(time: float, *, smooth: bool = False) -> TrialStep:
            restore_state(self._model, data, state)
            return self._try(data, state, start, time, reach=reach, smooth=smooth)

        longest = max(self._travel.between(start.contact_set.frames, data).max(initial=0.0), -trial_step.gap)
        begun = continued(trial_step.phase_end, tried, trial_step.deepest, trial_step.gap)
        if begun is not None:
            half, (straight, bent) = again(0.5 * tried.duration), begun
            smooth = abs(half.gap - straight - 0.25 * bent) <= _SMOOTH * abs(bent)
            if smooth or runs_on(half.phase_end, trial_step.phase_end, tried, trial_step.deepest):
                held = again(tried.duration, smooth=True)
                if held.gap >= -self.tolerance:
                    return held, False
        shortest = tried.duration * self.tolerance / max(longest, self.tolerance)
        located = locate(
            again,
            trial_step,
            gap_functions,
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
        self, data: mujoco.MjData, state: np.ndarray, start: ContactState, duration: float, *, hold_all: bool = False
    ) -> TrialStep:
        while True:
            self.work.integrate()
            self.advance(data, duration, start.force)
            if self._is_short(start.velocity, data.qvel, duration):
                break
            longest = self._travel.longest_turn(start.velocity)
            if duration > longest:
                restore_state(self._model, data, state)
                duration = longest
                continue
            travel = self._travel.between(start.contact_set.frames, data)
            suspects = self._travel.suspects(start.contact_set.frames, travel)
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
        phase = Phase(start, duration, self.tolerance, self._travel, self.work, hold_all, exact=self._exact)
        return self._arrive(data, phase) or self._without_force(data, state, phase)

    def _try(
        self,
        data: mujoco.MjData,
        state: np.ndarray,
        start: ContactState,
        duration: float,
        *,
        smooth: bool,
        reach: float,
    ) -> TrialStep:
        self.work.integrate()
        self.advance(data, duration, start.force)
        phase = Phase(start, duration, self.tolerance, self._travel, self.work, smooth=smooth, exact=self._exact)
        return self._arrive(data, phase, reach) or self._without_force(data, state, phase, reach)

    def _without_force(self, data: mujoco.MjData, state: np.ndarray, phase: Phase, reach: float = 0.0) -> TrialStep:
        """Fly once more, without the force of contacts that are lost."""
        restore_state(self._model, data, state)
        phase = phase._replace(start=phase.start._replace(force=None))
        self.work.integrate()
        self.advance(data, phase.duration)
        trial_step = self._arrive(data, phase, reach)
        assert trial_step is not None
        return trial_step

    def _match(self, data: mujoco.MjData, phase: Phase) -> tuple[ContactState, np.ndarray] | None:
        """Return the contacts where the flow has led, and those at its start that they continue; see `match`.

        Contacts whose force the flow has felt are looked for as far as that can have moved them. None if they are lost.
        """
        now, start = self.look(data), phase.start
        self.work.look(len(now.gap))
        known = match(self._model, data, now.contact_set, phase)
        if start.force is None or start.active is None:
            return now, known
        active = np.flatnonzero(start.active)
        if np.isin(active, known).all():
            return now, known
        now.contact_set.whitened(self._model, data)
        shift = FeltForce.of(self._model, data, start.force, phase.duration).shift
        now = self.look(data, start.contact_set.opening(shift))
        known = match(self._model, data, now.contact_set, phase)
        return (now, known) if np.isin(active, known).all() else None

    def _arrive(self, data: mujoco.MjData, phase: Phase, reach: float = 0.0) -> TrialStep | None:
        """Look at the contacts where the flow has led, and hold those that stay closed.

        None if contacts are lost whose force the flow has felt.

        Args:
            data: at the end of the flow.
            phase: what led there.
            reach: distance to look further if nothing is near, m.
        """
        found = self._match(data, phase)
        if found is None:
            return None
        now, known = found
        if not now.contact_set.pattern:
            return self._clear(phase, PhaseEnd(now, known, known), data, reach)
        if (
            now.quiet
            and phase.start.quiet
            and now.contact_set.pattern is phase.start.contact_set.pattern
            and now.contact_set.pattern.all_single
        ):
            return self._clear(phase, PhaseEnd(now, known, now.closed), data, reach)
        phase_end, keep = PhaseEnd(now, known, stays(now.gap, known, phase)), None
        held = phase_end.sustained if phase.start.force is not None else phase_end.sustained & now.closed
        if np.count_nonzero(held):
            again = self._again(data, phase, phase_end)
            phase_end, keep = hold(self._model, data, phase_end, phase, again)
        if np.count_nonzero(phase_end.sustained) == len(phase_end.sustained):
            return self._clear(phase, phase_end, data, reach, keep)
        return TrialStep.of(phase, phase_end, keep)

    def _again(
        self, data: mujoco.MjData, phase: Phase, phase_end: PhaseEnd
    ) -> Callable[[float], tuple[ContactState, np.ndarray]]:
        """Return what looks at the contacts of now up to a gap at least, m, and matches them with those at the start.

        Where the same pairs of geoms are near as before, with one contact each, these are the same contacts.
        """
        last, held = phase_end, phase_end.known[phase_end.sustained]
        look = self.look if last.now.contact_set.pattern.friction_pattern is None else self._look_at_places

        def look_again(within: float) -> tuple[ContactState, np.ndarray]:
            nonlocal last
            now, known, pattern = look(data, within), last.known, last.now.contact_set.pattern
            self.work.look(len(now.gap))
            if now.contact_set.pattern is not pattern or not pattern.distinct:
                known = refound(match(self._model, data, now.contact_set, phase), held, now.contact_set, phase)
            last = PhaseEnd(now, known, last.sustained)
            return now, known

        return look_again

    def _clear(
        self,
        phase: Phase,
        phase_end: PhaseEnd,
        data: mujoco.MjData,
        reach: float,
        keep: Callable[[], PhaseEnd] | None = None,
    ) -> TrialStep:
        """Return a flight where all contacts near are held; others are looked for up to a gap of ``reach``, m."""
        if reach <= self._near:
            return TrialStep(phase, phase_end, self._near, -1, keep=keep)
        contact_set = ContactSet(self._detector.look(data, reach), data, self.surfaces)
        observations = further(contact_set, self._near, phase.start.velocity, data.qvel)
        return TrialStep(
            phase, phase_end, min(observations[0].gap, reach) if observations else reach, -1, observations, keep
        )
