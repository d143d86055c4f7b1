"""Options and margins that a step changes in the model, and restores at its end."""

from __future__ import annotations

import mujoco

from impactlaw.scene.joint_limits import slack_ropes
from impactlaw.scene.pairs import some_side_by_side
from impactlaw.scene.tolerances import NEVER
from impactlaw.stepping.integration import NO_DAMPING, damps
from impactlaw.stepping.time_stepping.problem.detection.standing_cylinders import CYLINDER, PLANE

EULER, RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
_BODY = int(mujoco.mjtTrn.mjTRN_BODY)
FAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
OFF = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET) | int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
ON = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE) | int(mujoco.mjtEnableBit.mjENBL_SLEEP)
EXACT = int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
ELLIPTIC, NEWTON = int(mujoco.mjtCone.mjCONE_ELLIPTIC), int(mujoco.mjtSolver.mjSOL_NEWTON)
_MARGINS = ("body_margin", "geom_margin", "geom_gap", "pair_margin", "pair_gap", "jnt_margin", "tendon_margin")


class TemporaryOptions:
    """Changes options and margins of a model within a ``with`` block, which reads the user's own at its start.

    Cones are elliptic, and no body sleeps. MuJoCo's gaps count only if bodies stick across them. RK4 becomes Euler, and
    the implicit integrators become implicitfast, whose mass matrix is symmetric.

    Attributes:
        cone: kind of friction cone that the user has chosen.
        damped: whether the integrator damps implicitly, with its own mass matrix.
        sticks: whether bodies can stick across gaps.
        stands: whether cylinders can stand on planes.
        beside: whether cylinders or boxes can touch along a line.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model, self._opt = model, model.opt
        self._margins = [array for name in _MARGINS if (array := getattr(model, name)).size]
        self._kept = [array.copy() for array in self._margins]
        self._gaps = [array for name in ("geom_gap", "pair_gap") if (array := getattr(model, name)).size]
        self.sticks = bool(model.flg_adhesion or (model.actuator_trntype == _BODY).any())
        if self.sticks:  # bodies stick across the gap
            self._gaps = []
        self.stands, self.beside = {PLANE, CYLINDER} <= set(model.geom_type.tolist()), some_side_by_side(model)
        self.cone = model.opt.cone
        self.damped = False

    def __enter__(self) -> TemporaryOptions:
        opt, model = self._opt, self._model
        flags, integrator = opt.disableflags, opt.integrator
        self.cone = opt.cone
        self._options = flags, opt.enableflags, integrator, opt.solver, opt.noslip_iterations
        for kept, array in zip(self._kept, self._margins, strict=True):
            kept[:] = array
        self._ranges = model.tendon_range.copy()
        model.tendon_range[slack_ropes(model), 0] = NEVER
        for gap in self._gaps:
            gap[:] = 0.0
        opt.disableflags = flags | OFF
        opt.enableflags &= ~ON
        opt.cone, opt.solver, opt.noslip_iterations = ELLIPTIC, NEWTON, 0
        if integrator in (EULER, RK4):
            opt.integrator, self.damped = EULER, not flags & NO_DAMPING and damps(model)
        else:
            opt.integrator, self.damped = FAST, True
        return self

    def __exit__(self, *_: object) -> None:
        opt = self._opt
        opt.disableflags, opt.enableflags, opt.integrator, opt.solver, opt.noslip_iterations = self._options
        opt.cone = self.cone
        for kept, array in zip(self._kept, self._margins, strict=True):
            array[:] = kept
        self._model.tendon_range[:] = self._ranges

    def __getstate__(self) -> dict[str, mujoco.MjModel]:
        """Return the model only: a copy changes the copy of the model."""
        return {"model": self._model}

    def __setstate__(self, state: dict[str, mujoco.MjModel]) -> None:
        """Start again with the model."""
        self.__init__(state["model"])
