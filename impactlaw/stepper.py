"""Stepping a MuJoCo scene with a chosen impact law."""

from __future__ import annotations

from typing import Literal

import mujoco

from impactlaw import deferred
from impactlaw.collide import Collider
from impactlaw.contacts import GAP_TOLERANCE
from impactlaw.errors import SceneError, UnknownNameError
from impactlaw.events import ImpactEvent
from impactlaw.laws import Coulomb, Law, MaximalDissipation
from impactlaw.plan import make_plan
from impactlaw.rigid import RigidStepping
from impactlaw.scene import check_law, scene_law
from impactlaw.soft import REST_SPEED, SoftStepping
from impactlaw.solvers import SOLVERS


class Stepper:
    """Advances a scene by its own timestep under an impact law.

    With ``contact_model="rigid"`` MuJoCo does everything but contact and the law owns the contacts, with the friction
    of the scene: each step locates the times at which gaps close, resolves every collision by the law, and keeps
    touching contacts touching (`impactlaw.rigid`). With ``contact_model="soft"`` MuJoCo keeps contact and friction, and
    the law takes over collisions only; a step without one is `mj_step`, bit for bit (`impactlaw.soft`).

    Args:
        model: the compiled scene. Its options are read at every step, so they may be changed between steps (contacts
            and limits that they disable are off); shapes, limits and friction are read when the stepper is made or a
            contact is first seen.
        law: a `Law`, or "scene" for the restitution that the MJCF itself carries (`impactlaw.scene`).
        contact_model: "rigid" or "soft".
        friction: "coulomb" is exact Coulomb friction in collisions and in sustained contact, with the coefficients of
            the scene; "convex" its convex relaxation, in which contacts that slide also separate; "ignore" leaves it
            out (rigid). A law that is not a `Coulomb` becomes one where contacts have friction.
        overlap: "refuse" geoms that overlap and joints beyond their limits by more than gap_tolerance, or "push-out":
            move the configuration by the smallest shift in the kinetic metric that opens all gaps, with the velocity as
            it is (`impactlaw.overlap`). Looked at where the configuration is not the one that the last step has left,
            as at the start and after a reset (rigid).
        on_inadmissible: what to do with an outcome of the law outside of S(v-), that is one that would create
            energy or penetrate: "raise", "project" it onto S(v-), or "allow" it.
        gap_tolerance: gap up to which a contact counts as closed, and largest penetration at an event, m (rigid).
        rest_speed: closing speed above which a soft contact collides, m/s (soft).
        max_events: collisions of one step; what is left of a step with more is finished with E = 0.
        solver: a name from `impactlaw.solvers.SOLVERS`, or "auto".

    Attributes:
        events: the collisions of the last step, in order.
        plan: what a step does in this scene and what it leaves out (`impactlaw.plan`).
        unlocated: steps so far that had more than max_events collisions.

    Raises:
        SceneError: the scene holds something rigid stepping does not cover; the message says what to do.
        RestitutionError: law="scene" and the scene carries none.
        UnknownNameError: no such option, or the law is keyed by contacts that the scene cannot have.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law | Literal["scene"],
        *,
        contact_model: Literal["rigid", "soft"] = "rigid",
        friction: Literal["coulomb", "convex", "ignore"] = "coulomb",
        overlap: Literal["refuse", "push-out"] = "refuse",
        on_inadmissible: Literal["raise", "project", "allow"] = "raise",
        gap_tolerance: float = GAP_TOLERANCE,
        rest_speed: float = REST_SPEED,
        max_events: int = 100,
        solver: str = "auto",
    ):
        for kind, value, known in (
            ("contact_model", contact_model, ("rigid", "soft")),
            ("friction option", friction, ("coulomb", "convex", "ignore")),
            ("overlap option", overlap, ("refuse", "push-out")),
            ("on_inadmissible option", on_inadmissible, ("raise", "project", "allow")),
            ("solver", solver, ("auto", *SOLVERS)),
        ):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        if law == "scene":
            law = scene_law(model)
        elif not isinstance(law, Law):
            raise UnknownNameError("law", law, ("scene", "a Law, see impactlaw.make_law"))
        else:
            check_law(model, law)
        deferred.load_solvers()
        self.model = model
        self.law = law
        self.events: tuple[ImpactEvent, ...] = ()
        self.plan = make_plan(model, contact_model, friction=friction)
        last: Law = MaximalDissipation()
        if self.plan.friction:
            cone = "exact" if friction == "coulomb" else "convex"
            law = law if isinstance(law, Coulomb) else Coulomb(law, cone=cone)
            last = Coulomb(last, cone=cone)
        collider = Collider(law, last, on_inadmissible, max_events, solver)
        self._stepping: RigidStepping | SoftStepping
        if contact_model == "soft":
            self._stepping = SoftStepping(model, collider, self.plan, rest_speed=rest_speed)
        else:
            self._stepping = RigidStepping(
                model,
                collider,
                self.plan,
                exact=friction != "convex",
                gap_tolerance=gap_tolerance,
                push_out=overlap == "push-out",
            )

    @property
    def unlocated(self) -> int:
        """Steps so far that had more than max_events collisions."""
        return self._stepping.unlocated

    def step(self, data: mujoco.MjData) -> None:
        """Advance data by one ``model.opt.timestep``.

        Rigid steps leave frames and inertia current; soft ones leave them as `mj_step` does. A rigid step that raises
        leaves the state as it was before the step.

        Raises:
            OverlapError: geoms overlap at the start by more than the gap tolerance, or are squeezed so that they cannot
                be pushed out; names the pairs and depths.
            InadmissibleImpactError: the law would create energy and on_inadmissible is "raise".
            RestitutionError: the law's coefficients do not fit the contacts that collide.
            UnsolvableLawError: the law has no solution for the contacts that collide.
            SolverError: no solver's answer for these contacts passed its certificate.
            DivergenceError: position or velocity is not finite.
            SceneError: data is of a model with other bodies, joints or geoms.
        """
        if data.signature != self.model.signature:
            raise SceneError("data belongs to another model than the one that this stepper was made with")
        self.events = self._stepping.step(data)

    def finish_step(self, data: mujoco.MjData) -> None:
        """Do what follows `mj_step1` in a soft step, as `mj_step2` does.

        Raises:
            SceneError: the contact model is not "soft".
            ImpactLawError: as by `step`.
        """
        if not isinstance(self._stepping, SoftStepping):
            raise SceneError('only soft stepping can be cut in two halves; use step(), or contact_model="soft"')
        self.events = self._stepping.finish(data)
