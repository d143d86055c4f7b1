"""A law in a scene, with the options of the scheme, in the form in which compiled steps need them."""

from __future__ import annotations

import copy
from typing import Literal

import mujoco
import numpy as np

from impactlaw.errors import InadmissibleImpactError
from impactlaw.laws import Coulomb, Law
from impactlaw.laws.fremond import Reversal
from impactlaw.scene.contacts import geom_names
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.pairs import some_side_by_side
from impactlaw.scene.tolerances import meter
from impactlaw.stepping.compatibility import check_time_stepping
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.law_targets import LawTargets
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.time_stepping.compiled.detection.standing_cylinders import CYLINDER, PLANE
from impactlaw.stepping.time_stepping.compiled.state.law import reason
from impactlaw.stepping.time_stepping.inertial_forces import InertialForces
from impactlaw.stepping.time_stepping.problem.forces import listed_stage
from impactlaw.stepping.time_stepping.problem.tiny_gaps import TOUCHING
from impactlaw.stepping.time_stepping.tolerances import REST_SPEED

_BODY = int(mujoco.mjtTrn.mjTRN_BODY)


class LawInScene:
    """A law in a scene; see `Stepper` for the options.

    Args:
        model: the scene.
        law: the law.
        plan: the plan of the scene.
        friction: kind of friction.
        on_inadmissible: what to do with energy that the law would create.
        rest_speed: closing speed above which a contact collides, m/s or rad/s; None for the default.
        touching: gap, m or rad, up to which bodies at rest touch.
        in_python: whether collisions are kept, and the law is asked in Python even if compiled code has a table for it.

    Attributes:
        law: the law.
        targets: the contact velocities that the law aims at.
        exact: whether friction is exact Coulomb friction, or else its convex relaxation.
        reason: why the law must be asked in Python; None if compiled code covers it.
        names: names of geoms, as in labels of contacts.
        limits: the limits of joints and tendons.
        inertial: Coriolis and gyroscopic forces.
        carriers: the mocap body that carries each geom, see `Surfaces`, int32 (ngeom,).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law,
        plan: Plan,
        *,
        friction: Literal["coulomb", "convex", "ignore"],
        on_inadmissible: Literal["raise", "project", "allow"],
        rest_speed: float | None,
        touching: float = TOUCHING,
        in_python: bool = False,
    ):
        check_time_stepping(model)
        self.model, self.on_inadmissible, self._in_python = model, on_inadmissible, in_python
        self._exact_cones, self._friction, self._touching = friction != "convex", plan.friction, touching
        surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces and model.nmocap else None
        self._surfaces = 0.0 if surfaces is None else 1.0 + surfaces.meet
        self.carriers = np.full(model.ngeom, -1, np.int32) if surfaces is None else surfaces.carrier
        self.names, self.limits, self._meter = geom_names(model), Limits(model), meter(model.opt.gravity)
        self._rest_speed = REST_SPEED * self._meter if rest_speed is None else rest_speed
        self._rest_turn = REST_SPEED if rest_speed is None else rest_speed
        self.inertial, self._listed = InertialForces(model), listed_stage(model)
        self._sticks = bool(model.flg_adhesion or (model.actuator_trntype == _BODY).any())
        shapes = set(model.geom_type.tolist())
        self._stands, self._beside = shapes >= {PLANE, CYLINDER}, some_side_by_side(model)
        self._take(law)

    def _take(self, law: Law) -> None:
        self.law, self.targets = law, LawTargets(law, exact=self._exact_cones)
        self._sliding = law.tangential_restitution if isinstance(law, Coulomb) else 0.0
        self.exact = law.cone == "exact" if isinstance(law, Coulomb) else self._exact_cones
        self.reason = reason(self.targets, self.model)

    def under(self, law: Law) -> LawInScene:
        """Return the same for another law."""
        other = copy.copy(self)
        other._take(law)
        return other

    @property
    def asks(self) -> bool:
        """Whether the law is asked in Python, as it is not if one coefficient holds for all contacts."""
        return self.targets.restitution is None and (self._in_python or self.reason is not None)

    @property
    def keeps(self) -> bool:
        """Whether steps keep their collisions, instead of being taken again when events are read."""
        return self._in_python or self.asks

    def coefficients(self) -> Coefficients:
        """Return a table of the law's coefficients, initially empty."""
        return Coefficients(self.targets, self.names, self.limits, self.model.njnt)

    def settings(self) -> tuple[float, ...]:
        """Return the options in the form of compiled code, see `compiled.state.world.Settings`."""
        targets = self.targets
        dissipative = {"project": 1.0, "allow": 0.0, "raise": -1.0}[self.on_inadmissible]
        return (
            self._rest_speed,
            self._sliding,
            float(self.exact),
            dissipative,
            float(self._friction),
            float(self.inertial.act),
            float(self._sticks),
            1.0,
            np.nan if targets.restitution is None else targets.restitution,
            targets.law.restitution if isinstance(targets.law, Reversal) else np.nan,
            self._surfaces,
            0.0,
            float(self._stands),
            float(self._listed),
            self._meter,
            float(self._beside),
            self._touching * self._meter,
            0.0 if not self.asks else 1.0 if targets.alone else 2.0,
            self._rest_turn,
        )

    def inadmissible(self, created: float, time: float) -> InadmissibleImpactError:
        """Return the error of a step in which the law creates some energy, J."""
        return InadmissibleImpactError(
            f"{self.law!r} creates {created:.3g} J at t = {time:.6g} s; choose a dissipative law, or "
            'on_inadmissible="project" or "allow"'
        )
