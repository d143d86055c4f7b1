"""Stepping a MuJoCo scene with a chosen impact law."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import mujoco

from impactlaw.errors import ManyCollisionsWarning, SceneError, UnknownNameError
from impactlaw.laws import Law
from impactlaw.laws.restitution.from_scene import scene_law
from impactlaw.scene.contacts import is_data_of
from impactlaw.settled import Settled, places
from impactlaw.solvers import load_solvers
from impactlaw.stepping.compatibility import check_count, check_friction, check_law, check_model, check_scene_friction
from impactlaw.stepping.event_driven.scheme import RigidStepping
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, Told, sums_of, together
from impactlaw.stepping.integration import check_timestep
from impactlaw.stepping.left_out import LeftOut
from impactlaw.stepping.options import Options, select
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.soft.scheme import SoftStepping
from impactlaw.stepping.way import Way

if TYPE_CHECKING:
    from impactlaw.stepping.way import Stepping

_ANEW = "make a new Stepper"


class Stepper:
    """Advances a scene by its own timestep under an impact law.

    With ``contact_model="rigid"`` MuJoCo does everything but contact and the law owns the contacts, with the friction
    of the scene. Event-driven steps locate the times at which gaps close, resolve every collision by the law, and keep
    touching contacts touching (`impactlaw.stepping.event_driven`): exact; what takes too much work is time stepped.
    Time stepping solves one problem a step for impacts and held contact together (`impactlaw.stepping.time_stepping`):
    of first order in collisions, at a bounded price, and after the constructor nothing about contact raises. With
    ``contact_model="soft"`` MuJoCo keeps contact and friction, and the law takes over collisions only; a step without
    one is `mj_step`, bit for bit, unless contacts are tuned to bounce by themselves, or bodies touch where joints are
    damped by more than their inertia in a timestep (`impactlaw.stepping.soft`).

    Args:
        model: the compiled scene. Its options are read at every step, so they may be changed between steps (contacts
            and limits that they disable are off); the override of contacts is refused where these have friction
            (rigid). What else of it is changed later has its effect where MuJoCo reads it again; event-driven steps
            keep shapes as they were when a contact was first seen. Friction, contact, limits and belts that it comes to
            have, but had not when the stepper was made, are refused by the next step, and so are other limits of joints
            if it is event-driven.
        law: a `Law`, or "scene" for the restitution that the MJCF itself carries (`laws.restitution.from_scene`).
        contact_model: "rigid" or "soft".
        scheme: "event-driven", if not given, or "time-stepping" (rigid).
        friction: "coulomb", if not given, is exact Coulomb friction in collisions and in sustained contact, with the
            coefficients of the scene; "convex" its convex relaxation, in which contacts that slide also separate;
            "ignore" leaves it out. Under soft contact that is the friction of collisions only. A law without friction
            of its own gets `Coulomb` around it where contacts have friction.
        overlap: "refuse" geoms that overlap and joints beyond their limits by more than gap_tolerance (of meshes and
            height fields, what rounding to single precision makes is not counted), or "push-out": move the
            configuration by the smallest shift in the kinetic metric that opens all gaps, with the velocity as it is.
            Looked at where the configuration is not the one that the last step has left, as at the start and after a
            reset (event-driven; time stepping opens what overlaps over time).
        contacts: which contacts between geoms the law is for: a pattern such as "*foot*" or "*foot*/floor", or several
            (`laws.restitution.labels`); all if not given. The others are MuJoCo's soft contacts if contact_model is
            "soft", and do not collide by the law; where contacts are rigid they have E = 0.
        limits: whether the law is for the limits of joints and tendons, too; if not, they are as contacts left out.
        on_inadmissible: what to do with an outcome of the law outside of S(v-), that is one that would create
            energy or penetrate: "raise", the default, "project" it onto S(v-), or "allow" it. Under time stepping,
            where nothing penetrates, "project", the default, scales all restitution of a collision so that it creates
            none.
        on_unsolved: what to do where no certified impulses are found, where the law has no solution, where contact is
            not held or cannot be pushed out, and where a step takes too much work, which is counted, not timed: let
            "time-stepping", the default, take the rest of the step, or "raise" (event-driven).
        gap_tolerance: gap up to which a contact counts as closed, and largest penetration at an event, m; 1e-9 if not
            given (event-driven).
        rest_speed: closing speed above which a contact collides, m/s or rad/s: 0.1 for soft contacts if not given; 1e-3
            under time stepping, where forces must not have made more within a step.
        max_events: collisions of one step, 100 if not given; what is left of a step with more is finished with E = 0
            (soft), or time stepped if that would cost energy (event-driven). A larger one allows more work.
        solver: a name from `impactlaw.solvers.SOLVERS`, or "auto" (event-driven, soft).
        compiled: take steps in compiled code where that covers the scene and the law, or "never"; "auto" is the default
            and, if given, warns where steps are in Python (time stepping, soft).

    Attributes:
        law: the law; set to another one, it takes effect with the next step. The other options can be read, not set.
        events: the collisions of the last step, in order.
        plan: what a step does in this scene and what it leaves out (`impactlaw.stepping.plan`).
        unlocated: steps so far that had more than max_events collisions, or were time stepped in part or as a whole.
        shortfall: by how much a normal contact velocity of the last step missed its law (time stepping).
        short_steps: steps so far in which that was too much, or friction was not found (time stepping, and what it
            takes of event-driven steps); in which contacts lost their restitution; or in which bodies jammed, and
            MuJoCo's contacts were left alone (soft).

    Raises:
        SceneError: the scene holds something rigid stepping does not cover, or its timestep is not positive, or an
            option means nothing to this way to step; the message says what to do.
        RestitutionError: law="scene" and the scene carries none, or the law is for more contacts than the scene can
            have, or for other velocities, or for friction where there is none.
        UnknownNameError: no such option, or the law is keyed by contacts that the scene cannot have.
        OptionError: rest_speed is not a speed, gap_tolerance no length, max_events no count, or contacts no patterns.

    Warns:
        HeldJointsWarning: time stepping may hold joints still: links overlap, or dry friction holds servos.
        UnreadSensorsWarning: event-driven steps leave sensors of contact without forces.
    """

    model, plan = Settled(_ANEW), Settled(_ANEW)
    contact_model, scheme, friction, overlap = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    contacts, limits = Settled(_ANEW), Settled(_ANEW)
    on_inadmissible, gap_tolerance, rest_speed = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    on_unsolved, max_events, solver = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    compiled = Settled(_ANEW)
    __slots__ = (
        *places("model", "plan", "contacts", "limits", *Options._fields),
        *("_model", "_law", "_chosen", "_left_out", "_way", "_stepping", "_is_soft", "_at_once", "_events", "_warned"),
        "__weakref__",
    )

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
            contact_model=contact_model,
            scheme=scheme,
            friction=friction,
            overlap=overlap,
            on_inadmissible=on_inadmissible,
            on_unsolved=on_unsolved,
            gap_tolerance=gap_tolerance,
            rest_speed=rest_speed,
            max_events=max_events,
            solver=solver,
            compiled=compiled,
        )
        options.check()
        check_model(model)
        check_timestep(model.opt.timestep)
        if options.way != "time-stepping":  # that has solvers of its own
            load_solvers()
        for name, value in options._asdict().items():
            setattr(self, name, value)
        self.model = self._model = model
        self.contacts, self.limits = contacts, limits
        self._chosen = select(model, contacts, limits)
        self._law = self._known(law)
        self.plan = make_plan(model, contact_model, scheme=scheme, friction=friction or "coulomb")
        check_scene_friction(model, self.plan)
        self._left_out = LeftOut(model, self.plan, friction or "coulomb") or None
        self._way = Way(model, self.plan, options, self._chosen)
        self._stepping = self._way.stepping(self._law)
        self._is_soft = contact_model == "soft"
        self._at_once = self._is_soft and not isinstance(self._stepping, SoftStepping)  # takes several steps at once
        self._events: Told = ()
        self._warned = False

    @property
    def law(self) -> Law:
        """The law; set it to another `Law`, or "scene", and the next step is under that one.

        Raises:
            RestitutionError: as the constructor, and the law stays what it was.
            UnknownNameError: as the constructor, and the law stays what it was.
        """
        return self._law

    @law.setter
    def law(self, law: Law | Literal["scene"]) -> None:
        known = self._known(law)
        self._stepping.set_law(self._way.law_for(known))
        self._law = known

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions of the last call, in order; compiled steps resolve them when they are first asked for."""
        return self._events() if callable(self._events) else self._events

    @property
    def told(self) -> Told:
        """The collisions of the last call, or what returns them, also after further steps: they may not be resolved."""
        return self._events

    @property
    def sums(self) -> ImpactSums:
        """Sums over the collisions of the last call; compiled steps find them without resolving any event."""
        return sums_of(self._events)

    @property
    def stepping(self) -> Stepping:
        """What takes the steps: its class tells the way, and whether compiled code covers scene and law."""
        return self._stepping

    @property
    def unlocated(self) -> int:
        """Steps so far that had more than max_events collisions (soft), or were time stepped in part (event-driven)."""
        return self._stepping.unlocated

    @property
    def shortfall(self) -> float:
        """Largest amount by which a normal contact velocity of the last step misses its law, m/s or rad/s.

        Under other schemes than time stepping it is 0: they certify every collision, or refuse it.
        """
        return getattr(self._stepping, "shortfall", 0.0)

    @property
    def short_steps(self) -> int:
        """Steps so far that did not meet their law.

        Time stepping: their shortfall was above 1e-6 of the largest contact velocity, or 1e-8 m/s; or friction was not
        found, since its natural map stayed above 1e-6 of the largest velocity; or contacts lost their restitution:
        those that are hit through others, one after another, were too many for a step, or friction jams bodies.
        Event-driven: so it was in what time stepping has taken of a step. Soft: friction or constraints jam bodies, no
        matter what the law is, and MuJoCo's contacts were left alone.
        """
        return getattr(self._stepping, "short_steps", 0)

    def step(self, data: mujoco.MjData, steps: int = 1) -> None:
        """Advance data by one ``model.opt.timestep``, or by several.

        Rigid steps leave frames and inertia current; soft ones leave them as `mj_step` does. A rigid step that raises
        leaves the state as it was before the step.

        Args:
            data: of the scene.
            steps: timesteps; `events` are those of all of them.

        Raises:
            OverlapError: geoms overlap at the start by more than the gap tolerance, or are squeezed so that they cannot
                be pushed out, and on_unsolved is "raise"; names the pairs and depths.
            InadmissibleImpactError: the law would create energy and on_inadmissible is "raise".
            RestitutionError: the law's coefficients do not fit the contacts that collide.
            UnsolvableLawError: the law has no solution for the contacts that collide, and on_unsolved is "raise".
            SolverError: no solver's answer for these contacts passed its certificate, and on_unsolved is "raise"
                (event-driven).
            UnfinishedStepError: the step takes too much work, or contact is not held, and on_unsolved is "raise".
            DivergenceError: position or velocity is not finite.
            mujoco.FatalError: MuJoCo's own memory is too small, or it refuses what was written into the model.
            SceneError: data is no MjData, or of a model with other bodies, joints or geoms; or the model has come to
                need what the plan has left out, such as friction, or has other limits of joints (event-driven).
        """
        if not isinstance(data, mujoco.MjData) or not is_data_of(self._model, data):
            raise _other_model(data)
        self._events = ()
        if self._left_out is not None and self._left_out.check() and isinstance(self._stepping, RigidStepping):
            self._stepping.learn_friction()
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
        told: list[Told] = []
        for _ in range(steps):
            self.step(data)
            if self._events:
                told.append(self._events)
        self._events = together(told)

    def finish_step(self, data: mujoco.MjData) -> None:
        """Do what follows `mj_step1` in a soft step, as `mj_step2` does.

        Raises:
            SceneError: the contact model is not "soft", or data is no MjData, or of another model.
            ImpactLawError: as by `step`.
        """
        if not isinstance(data, mujoco.MjData) or not is_data_of(self._model, data):
            raise _other_model(data)
        if not self._is_soft:
            raise SceneError('only soft stepping can be cut in two halves; use step(), or contact_model="soft"')
        self._events = ()
        if self._left_out is not None:
            self._left_out.check()
        self._events = self._stepping.finish(data)  # pyright: ignore[reportAttributeAccessIssue]

    def _known(self, law: Law | Literal["scene"]) -> Law:
        """Return the law, if it can be that of the scene and of the way to step."""
        if isinstance(law, str) and law == "scene":
            law = scene_law(self.model)
        if not isinstance(law, Law):
            known = "scene", 'a Law, such as impactlaw.make_law("moreau", 0.5)'
            raise UnknownNameError("law of a stepper", law, known)
        check_law(self.model, law, self._chosen)
        check_friction(law, self.friction, self.solver)
        return law


def _other_model(data: object) -> SceneError:
    if not isinstance(data, mujoco.MjData):
        return SceneError(f"data is the mujoco.MjData of the scene, got {data!r:.100}")
    return SceneError("data belongs to another model than the one that this stepper was made with")


_CROWDED = (
    "a step that ended at t = {:.6g} s had too many collisions to locate them all: time stepping has resolved them at "
    "once, and Stepper.unlocated counts such steps; max_events=1000, or another number above 100, locates more, a "
    'smaller timestep has fewer, and scheme="time-stepping" is for so many'
)
