"""Stepping a MuJoCo scene with a chosen impact law."""

from __future__ import annotations

from typing import Literal

import mujoco

from impactlaw.contacts import GAP_TOLERANCE
from impactlaw.errors import UnknownNameError
from impactlaw.events import ImpactEvent
from impactlaw.laws import Law
from impactlaw.rigid import RigidStepping
from impactlaw.scene import scene_law


class Stepper:
    """Advances a scene by its own timestep; MuJoCo does everything but contact, the law owns the contacts.

    Each step locates the times at which gaps close, resolves every collision by the law, and keeps touching
    contacts touching with the impulse of the same complementarity problem. See `impactlaw.rigid`.

    Args:
        model: the compiled scene. Its options are read at every step, so they may be changed between steps.
        law: a `Law`, or "scene" for the restitution that the MJCF itself carries (`impactlaw.scene`).
        contact_model: "rigid".
        friction: "refuse" scenes with friction, or "ignore" it.
        on_inadmissible: what to do with an outcome of the law outside of S(v-), that is one that would create
            energy or penetrate: "raise", "project" it onto S(v-), or "allow" it.
        gap_tolerance: gap up to which a contact counts as closed, and largest penetration at an event, m.
        max_events: collisions located in one step; what is left of a step with more is finished by time stepping
            with E = 0.
        solver: a name from `impactlaw.solvers.SOLVERS`, or "auto".

    Attributes:
        events: the collisions of the last step, in order.
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
        contact_model: Literal["rigid"] = "rigid",
        friction: Literal["refuse", "ignore"] = "refuse",
        on_inadmissible: Literal["raise", "project", "allow"] = "raise",
        gap_tolerance: float = GAP_TOLERANCE,
        max_events: int = 100,
        solver: str = "auto",
    ):
        for kind, value, known in (
            ("contact_model", contact_model, ("rigid",)),
            ("friction option", friction, ("refuse", "ignore")),
            ("on_inadmissible option", on_inadmissible, ("raise", "project", "allow")),
        ):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        if law == "scene":
            law = scene_law(model)
        elif not isinstance(law, Law):
            raise UnknownNameError("law", law, ("scene", "a Law, see impactlaw.make_law"))
        self.model = model
        self.law = law
        self.events: tuple[ImpactEvent, ...] = ()
        self._stepping = RigidStepping(
            model,
            law,
            ignore_friction=friction == "ignore",
            on_inadmissible=on_inadmissible,
            gap_tolerance=gap_tolerance,
            max_events=max_events,
            solver=solver,
        )

    @property
    def unlocated(self) -> int:
        """Steps so far that had more than max_events collisions."""
        return self._stepping.unlocated

    def step(self, data: mujoco.MjData) -> None:
        """Advance data by one ``model.opt.timestep``; frames and inertia are current afterwards.

        Raises:
            OverlapError: geoms overlap at the start by more than the gap tolerance; names the pairs and depths.
            InadmissibleImpactError: the law would create energy and on_inadmissible is "raise".
            UnsolvableLawError: the law has no solution for the contacts that collide.
            DivergenceError: position or velocity is not finite.
        """
        self.events = self._stepping.step(data)
