"""Make the object that takes the steps of a stepper from its options: event-driven, soft, or time stepping."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import mujoco

from impactlaw.errors import FlexContactsWarning, UncompilableError, UnreadSensorsWarning, warn_of_python
from impactlaw.laws import Coulomb, Law, MaximalDissipation
from impactlaw.laws.restitution.on_contacts import Chosen, restricted
from impactlaw.scene.tolerances import GAP_TOLERANCE, meter
from impactlaw.stepping.cautions import warn_of_held_joints
from impactlaw.stepping.collisions import Collider
from impactlaw.stepping.compatibility import flexes_touch, unread_sensors
from impactlaw.stepping.event_driven.rest_of_step import RestOfStep
from impactlaw.stepping.event_driven.scheme import RigidStepping
from impactlaw.stepping.options import Options
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.soft.scheme import SoftStepping

if TYPE_CHECKING:
    from impactlaw.stepping.soft.compiled.stepping import CompiledSoftStepping
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    Stepping = RigidStepping | SoftStepping | CompiledSoftStepping | TimeStepping

_EVENTS = 100  # default of max_events, the largest number of collisions in one step
_UNREAD = (
    "event-driven steps leave no forces of contacts and limits in data: sensors such as {} read as if there were none; "
    'use scheme="time-stepping" or contact_model="soft" for them'
)

_FLEXES = (
    "a law acts between geoms, and flexes of this scene can touch: their contacts stay MuJoCo's, without restitution; "
    "contacts= with the contacts of geoms says that this is meant"
)


@dataclass(frozen=True, eq=False)
class Way:
    """How a scene is stepped, independent of the law."""

    model: mujoco.MjModel  # the scene
    plan: Plan  # which parts of a step the scene needs
    options: Options  # as given to the stepper
    chosen: Chosen | None  # the contacts that the law is for; None for all

    def stepping(self, law: Law) -> Stepping:
        """Return the object that takes steps under a law."""
        if self.options.way == "time-stepping":
            from impactlaw.stepping.time_stepping.make import make_time_stepping

            warn_of_held_joints(self.model, stacklevel=4)
            return make_time_stepping(
                self.model,
                self.law_for(law),
                self.plan,
                friction=self._friction,
                on_inadmissible=self.options.on_inadmissible or "project",
                rest_speed=self.options.rest_speed,
                compiled=self.options.compiled,
            )
        return self._soft(law) if self.options.way == "soft" else self._event_driven(law)

    def law_for(self, law: Law) -> Law:
        """Return the law with E = 0 for contacts that were not chosen, and with the friction of the scene.

        Soft steps leave contacts that were not chosen to MuJoCo. Time stepping adds friction by itself.
        """
        return self._with_friction(self._of_chosen(law))

    def _of_chosen(self, law: Law) -> Law:
        return law if self.chosen is None or self.options.way == "soft" else restricted(law, self.chosen)

    def _with_friction(self, law: Law) -> Law:
        if not self.plan.friction or self.options.way == "time-stepping" or law.has_friction:
            return law
        return Coulomb(law, cone="convex" if self.options.friction == "convex" else "exact")

    @property
    def _friction(self) -> Literal["coulomb", "convex", "ignore"]:
        return self.options.friction or "coulomb"

    def _collider(self, law: Law) -> Collider:
        """Return the collider, which resolves one collision after another."""
        o, last = self.options, self._with_friction(MaximalDissipation())
        most = _EVENTS if o.max_events is None else o.max_events
        return Collider(self.law_for(law), last, o.on_inadmissible or "raise", most, o.solver or "auto")

    def _event_driven(self, law: Law) -> RigidStepping:
        o, collider, rest = self.options, self._collider(law), None
        if sensors := unread_sensors(self.model, self.plan):
            warnings.warn(_UNREAD.format(", ".join(sensors[:5])), UnreadSensorsWarning, stacklevel=4)
        if o.on_unsolved != "raise":
            own = self._of_chosen(law)
            rest = RestOfStep(self.model, own, friction=self._friction, on_inadmissible=collider.on_inadmissible)
        return RigidStepping(
            self.model,
            collider,
            self.plan,
            exact=self._friction != "convex",
            gap_tolerance=GAP_TOLERANCE * meter(self.model.opt.gravity) if o.gap_tolerance is None else o.gap_tolerance,
            push_out=o.overlap == "push-out",
            rest=rest,
        )

    def _soft(self, law: Law) -> SoftStepping | CompiledSoftStepping:
        """Return soft stepping, in compiled code if it covers the scene and the law."""
        o = self.options
        if self.chosen is None and flexes_touch(self.model):
            warnings.warn(_FLEXES, FlexContactsWarning, stacklevel=4)
        scheme = SoftStepping(self.model, self._collider(law), self.plan, rest_speed=o.rest_speed, chosen=self.chosen)
        if o.compiled == "never":
            return scheme
        try:
            from impactlaw.compiled import compile_together

            compile_together("impactlaw.stepping.soft.compiled.entry")
            from impactlaw.stepping.soft.compiled.stepping import CompiledSoftStepping

            return CompiledSoftStepping(scheme, warn=o.compiled == "auto")
        except UncompilableError as error:
            if o.compiled == "auto":
                warn_of_python(error)
            return scheme
