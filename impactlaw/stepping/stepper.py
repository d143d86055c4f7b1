"""Stepping a MuJoCo scene with a chosen impact law."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import mujoco

from impactlaw.errors import ManyCollisionsWarning, SceneError, UnknownNameError, instead_of
from impactlaw.laws import Law
from impactlaw.laws.restitution.from_scene import SceneNumbers, scene_law
from impactlaw.scene.contacts import is_data_of
from impactlaw.settled import Settled, places
from impactlaw.solvers import load_solvers
from impactlaw.stepping.compatibility import check_count, check_friction, check_law, check_model, check_scene_friction
from impactlaw.stepping.event_driven.scheme import RigidStepping
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, LazyEvents, sums_of, together
from impactlaw.stepping.integration import check_timestep
from impactlaw.stepping.options import Options, select
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.plan_check import PlanCheck
from impactlaw.stepping.soft.scheme import SoftStepping
from impactlaw.stepping.way import Way

if TYPE_CHECKING:
    from impactlaw.stepping.way import Stepping

_ANEW = "make a new Stepper"


class Stepper:
    """Advances a scene by its own timestep under an impact law.

    With ``contact_model="rigid"`` the law governs all contacts, with the friction of the scene, and MuJoCo does
    everything else. There are two schemes:

    - Event-driven steps locate the times at which gaps close, resolve every collision by the law, and hold closed
      contacts closed (`impactlaw.stepping.event_driven`). Collisions are exact to rounding. The rest of a step that
      takes too much work is time stepped.
    - Time stepping solves one problem per step for impacts and persistent contact together
      (`impactlaw.stepping.time_stepping`). It is of first order in collisions, and its cost is bounded. Contact makes
      it raise only if the law has no coefficient for it, MuJoCo has no memory, or ``on_inadmissible="raise"``.

    With ``contact_model="soft"`` MuJoCo keeps contact and friction, and the law takes over collisions only
    (`impactlaw.stepping.soft`). A step without a collision is `mj_step`, bit for bit, with two exceptions: contacts
    that are tuned to bounce by themselves, and bodies in contact while the damping of a joint exceeds its inertia
    within a timestep.

    Args:
        model: the compiled scene. Its options are read at every step and may be changed between steps; contacts and
            limits that they disable are off. Rigid steps refuse the override of contacts if contacts have friction.
            Any other change takes effect where MuJoCo reads the field again. If the model later gets friction,
            contacts, limits or belts that it did not have when the stepper was made, the next step raises. So does an
            event-driven step if the limits of joints have changed.
        law: a `Law`, or "scene" for the restitution that the MJCF itself carries (`laws.restitution.from_scene`). If
            that changes in ``model.numeric_data``, the next step is under the new one, or raises if it is invalid.
        contact_model: "rigid" or "soft".
        scheme: "event-driven" (the default) or "time-stepping" (rigid).
        friction: "coulomb" (the default) is exact Coulomb friction in collisions and in persistent contact, with the
            coefficients of the scene. "convex" is its convex relaxation, in which sliding contacts also separate.
            "ignore" leaves friction out. Under soft contact the option concerns collisions only. A law without
            friction of its own is wrapped in `Coulomb` if contacts have friction.
        overlap: what to do with geoms that overlap, and joints beyond their limits, by more than gap_tolerance
            (penetration of meshes and height fields that comes from rounding to single precision is not counted).
            "refuse" (the default) raises an error. "push-out" moves the configuration by the smallest shift in the
            kinetic metric that opens all gaps, and keeps the velocity. Overlap is checked only where the configuration
            is not the one that the last step left, as at the start and after a reset. (Event-driven; time stepping
            opens overlaps over time.)
        contacts: the contacts between geoms that the law is for: a pattern such as "*foot*" or "*foot*/floor", or
            several patterns (`laws.restitution.labels`); all contacts by default. The others do not collide by the
            law: they remain MuJoCo's soft contacts if contact_model is "soft", and are rigid with E = 0 otherwise.
        limits: whether the law is also for the limits of joints and tendons; if not, limits are treated like the
            contacts that the law is not for.
        on_inadmissible: what to do with an outcome of the law outside of S(v-), that is, one that would create
            energy or penetrate: "raise" (the default), "project" it onto S(v-), or "allow" it. In time stepping no
            outcome penetrates; there "project" is the default and scales all restitution of a collision so that it
            creates no energy.
        on_unsolved: what to do if no certified impulses are found, the law has no solution, contact is not held,
            overlap cannot be pushed out, or a step takes too much work (work is counted, not timed): "time-stepping"
            (the default) takes the rest of the step, "raise" raises an error (event-driven).
        gap_tolerance: gap up to which a contact counts as closed, and largest penetration at an event, m; 1e-9 by
            default, 1e-6 in millimeters, see `scene.tolerances.meter` (event-driven).
        rest_speed: closing speed above which a contact collides, m/s or rad/s. By default 1e-3 for time stepping (1 in
            millimeters, but for limits of joints), where the speed must also exceed what forces produce within a step,
            and for soft contacts 0.1, or 1.5 times what gravity gives in a timestep (as they are when the stepper is
            made) if that is more.
        max_events: largest number of collisions in one step, 100 by default. The rest of a step with more is finished
            with E = 0 (soft), or time stepped if E = 0 would cost energy (event-driven). A larger number also allows
            more work.
        solver: a name from `impactlaw.solvers.SOLVERS`, or "auto" (event-driven, soft).
        compiled: "auto" (the default) takes soft steps in compiled code if it covers the scene and the law, and "never"
            takes them in Python. So are those while a callback of MuJoCo is set, and of the integrator "discrete". Time
            steps are always in compiled code: "auto" asks a law in Python at each collision if there is no table for
            it, "never" whenever it has not the same coefficient for all contacts. An explicit "auto" warns of steps,
            or of a law, in Python.

    `law` can be set; the other options can only be read.

    Attributes:
        plan: what a step does in this scene and what it leaves out (`impactlaw.stepping.plan`).

    Raises:
        SceneError: the scene contains something that rigid stepping does not cover, its timestep is not positive, or
            an option does not apply to this way to step. The message says what to do.
        RestitutionError: law="scene" and the scene carries no restitution; or the law is for more contacts than the
            scene can have, for another number of velocities, or for friction where there is none.
        UnknownNameError: there is no such option, or the law is keyed by contacts that the scene cannot have.
        OptionError: rest_speed is not a speed, gap_tolerance not a length, max_events not a count, contacts not
            patterns, or limits neither True nor False.
        UncompilableError: time stepping needs numba, which cannot be imported, or MuJoCo keeps its data elsewhere than
            it says.

    Warns:
        HeldJointsWarning: time stepping may hold joints still, because links overlap or dry friction exceeds the
            force of servos.
        UnreadSensorsWarning: event-driven steps leave contact sensors without forces.
        FlexContactsWarning: contacts of flexes stay MuJoCo's (soft).
        UncompiledWarning: steps are in Python, or ask the law there, although compiled="auto" was given.
    """

    model, plan = Settled(_ANEW), Settled(_ANEW)
    contact_model, scheme, friction, overlap = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    contacts, limits = Settled(_ANEW), Settled(_ANEW)
    on_inadmissible, gap_tolerance, rest_speed = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    on_unsolved, max_events, solver = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    compiled = Settled(_ANEW)
    __slots__ = (
        *places("model", "plan", "contacts", "limits", *Options._fields),
        "_model", "_law", "_chosen", "_plan_check", "_signature", "_way", "_stepping", "_is_soft", "_at_once",
        "_carried", "_events", "_warned", "__weakref__",
    )  # fmt: skip

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law | Literal["scene"],
        *,
        contact_model: Literal["rigid", "soft"] = "rigid",
        scheme: Literal["event-driven", "time-stepping"] | None = None,
        friction: Literal["coulomb", "convex", "ignore"] | None = None,
        overlap: Literal["refuse", "push-out"] | None = None,
        contacts: str | Sequence[str] | None = None,
        limits: bool = True,
        on_inadmissible: Literal["raise", "project", "allow"] | None = None,
        on_unsolved: Literal["time-stepping", "raise"] | None = None,
        gap_tolerance: float | None = None,
        rest_speed: float | None = None,
        max_events: int | None = None,
        solver: str | None = None,
        compiled: Literal["auto", "never"] | None = None,
    ):
        options = Options(
            contact_model=contact_model, scheme=scheme, friction=friction, overlap=overlap,
            on_inadmissible=on_inadmissible, on_unsolved=on_unsolved, gap_tolerance=gap_tolerance,
            rest_speed=rest_speed, max_events=max_events, solver=solver, compiled=compiled,
        )  # fmt: skip
        options.check()
        check_model(model)
        check_timestep(model.opt.timestep)
        if options.way != "time-stepping":  # time stepping has its own solvers
            load_solvers()
        for name, value in options._asdict().items():
            setattr(self, name, value)
        self.model = self._model = model
        self.contacts, self.limits = contacts, limits
        self._signature = model.signature or None  # 0 tells nothing
        self._chosen = select(model, contacts, limits)
        self._law = self._known(law)
        self.plan = make_plan(model, contact_model, scheme=scheme, friction=friction or "coulomb")
        check_scene_friction(model, self.plan)
        self._plan_check = PlanCheck(model, self.plan, friction or "coulomb") or None
        self._carried = _carried(model, law)
        self._way = Way(model, self.plan, options, self._chosen)
        self._stepping = self._way.stepping(self._law)
        self._is_soft = contact_model == "soft"
        self._at_once = self._is_soft and not isinstance(self._stepping, SoftStepping)  # takes several steps at once
        self._events: LazyEvents = ()
        self._warned = False

    @property
    def law(self) -> Law:
        """The law. It can be set to another `Law`, or "scene", which takes effect with the next step.

        Raises:
            RestitutionError: for the same reasons as in the constructor; the law remains unchanged.
            UnknownNameError: for the same reasons as in the constructor; the law remains unchanged.
        """
        return self._law

    @law.setter
    def law(self, law: Law | Literal["scene"]) -> None:
        known = self._known(law)
        self._stepping.set_law(self._way.law_for(known))
        self._law, self._carried = known, _carried(self._model, law)

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions of the last call, in order; compiled steps resolve them when they are first read.

        Raises:
            SceneError: the model has changed since, so that a compiled step cannot be repeated.
        """
        return self._events() if callable(self._events) else self._events

    @property
    def told(self) -> LazyEvents:
        """The collisions of the last call, or a function that resolves and returns them, also after further steps."""
        return self._events

    @property
    def sums(self) -> ImpactSums:
        """Sums over the collisions of the last call; compiled steps compute them without resolving any event."""
        return sums_of(self._events)

    @property
    def stepping(self) -> Stepping:
        """The object that takes the steps; its class tells the way to step and whether the steps are compiled."""
        return self._stepping

    @property
    def unlocated(self) -> int:
        """Number of steps so far with more than max_events collisions (soft) or time stepped in part (event-driven)."""
        return self._stepping.unlocated

    @property
    def shortfall(self) -> float:
        """Largest amount by which a normal contact velocity of the last step misses the law, m/s or rad/s.

        It is 0 except in time stepping: the other schemes certify every collision or refuse it.
        """
        return getattr(self._stepping, "shortfall", 0.0)

    @property
    def short_steps(self) -> int:
        """Number of steps so far that did not meet the law.

        - Time stepping counts a step if its shortfall was above 1e-6 of the largest contact velocity and 1e-8 m/s; if
          friction was not found, that is, if its natural map stayed above 1e-6 of the largest velocity; if bodies that
          did not overlap before overlap by more than 1e-5 m at its end, or at its start if the step before did not see
          the contact; or if contacts lost their restitution, because too many were hit through others, one after
          another, for one step, or because friction jams bodies.
        - Event-driven steps count by the same rule if time stepping took over part of them.
        - Soft steps count if contacts lost their restitution, or if friction or constraints jam bodies whatever the
          law is, so that they were left to MuJoCo's contacts.
        """
        return getattr(self._stepping, "short_steps", 0)

    def step(self, data: mujoco.MjData, steps: int = 1) -> None:
        """Advance data by one ``model.opt.timestep``, or by several.

        Rigid steps leave frames and inertia current; soft steps leave them as `mj_step` does. A rigid step that raises
        leaves the state as it was before the step.

        Args:
            data: the state of the scene. It is stepped with the model of this stepper, even if it belongs to another
                one of the same structure, such as `MjSpec.recompile` returns: make a new Stepper for that.
            steps: number of timesteps; `events` then holds the collisions of all of them.

        Raises:
            OverlapError: geoms overlap at the start by more than the gap tolerance, or are squeezed so that they cannot
                be pushed out, and on_unsolved is "raise". The message names the pairs and depths.
            InadmissibleImpactError: the outcome of the law is not in S(v-) and on_inadmissible is "raise".
            RestitutionError: the law's coefficients do not fit the contacts that collide, or those that the scene
                carries are invalid now.
            OptionError: steps is not a positive whole number.
            UnsolvableLawError: the law has no solution for the contacts that collide, and on_unsolved is "raise".
            SolverError: no solver's answer for these contacts passed its certificate, and on_unsolved is "raise"
                (event-driven).
            UnfinishedStepError: the step takes too much work, or contact is not held, and on_unsolved is "raise".
            UncompilableError: several contacts with friction collide, but numba cannot be imported.
            DivergenceError: position or velocity is not finite.
            mujoco.FatalError: MuJoCo's own memory is too small, or MuJoCo refuses a value written into the model.
            SceneError: data is not an MjData, or belongs to a model with other bodies, joints or geoms; the timestep is
                not positive; or the model now needs something that the plan has left out, such as friction, or its
                limits of joints have changed (event-driven).

        Warns:
            ManyCollisionsWarning: once, if a step has too many collisions to locate them all (event-driven).
        """
        if data.__class__ is not mujoco.MjData or data.signature != self._signature:
            _check_data(self._model, data)
        self._events = ()
        if self._plan_check is not None and self._plan_check.check() and isinstance(self._stepping, RigidStepping):
            self._stepping.learn_friction()
        if self._carried is not None and self._carried.changed():
            self.law = "scene"
        if steps.__class__ is not int or steps < 1:
            check_count("steps", steps)
        if self._at_once:
            self._events = self._stepping.step(data, steps)  # pyright: ignore[reportCallIssue]
            return
        if steps != 1:
            self._several(data, steps)
            return
        self._events = self._stepping.step(data)
        if isinstance(self._stepping, RigidStepping) and self._stepping.crowded and not self._warned:
            self._warned = True
            warnings.warn(_CROWDED.format(data.time), ManyCollisionsWarning, stacklevel=2)

    def _several(self, data: mujoco.MjData, steps: int) -> None:
        told: list[LazyEvents] = []
        for _ in range(steps):
            self.step(data)
            if self._events:
                told.append(self._events)
        self._events = together(told)

    def finish_step(self, data: mujoco.MjData) -> None:
        """Finish a soft step after `mj_step1`, in place of `mj_step2`.

        Raises:
            SceneError: the contact model is not "soft", or data is not an MjData or belongs to another model.
            ImpactLawError: for the same reasons as in `step`.
        """
        if data.__class__ is not mujoco.MjData or data.signature != self._signature:
            _check_data(self._model, data)
        if not self._is_soft:
            raise SceneError('only soft stepping can be cut in two halves; use step(), or contact_model="soft"')
        self._events = ()
        if self._plan_check is not None:
            self._plan_check.check()
        if self._carried is not None and self._carried.changed():
            self.law = "scene"
        self._events = self._stepping.finish(data)  # pyright: ignore[reportAttributeAccessIssue]

    def _known(self, law: Law | Literal["scene"]) -> Law:
        """Return the law, or that of the scene, after checking that it fits the scene and the way to step."""
        if isinstance(law, str) and law == "scene":
            law = scene_law(self.model)
        if not isinstance(law, Law):
            known = "scene", 'a Law, such as impactlaw.make_law("moreau", 0.5)'
            raise UnknownNameError("law of a stepper", law, known)
        check_law(self.model, law, self._chosen)
        check_friction(law, self.friction, self.solver)
        return law


def _carried(model: mujoco.MjModel, law: Law | Literal["scene"]) -> SceneNumbers | None:
    """Return what tells of changes of the law that the scene carries; None if that is not the law."""
    return SceneNumbers(model) if isinstance(law, str) else None


def _check_data(model: mujoco.MjModel, data: object) -> None:
    if not isinstance(data, mujoco.MjData):
        raise SceneError(f"data is the mujoco.MjData of the scene, got {data!r:.100}{instead_of(data)}")
    if not is_data_of(model, data):
        raise SceneError("data belongs to another model than the one that this stepper was made with")


_CROWDED = (
    "a step that ended at t = {:.6g} s had too many collisions to locate them all: time stepping has resolved them at "
    "once, and Stepper.unlocated counts such steps; max_events=1000, or another number above 100, locates more, a "
    'smaller timestep has fewer, and scheme="time-stepping" is for so many'
)
