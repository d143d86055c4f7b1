"""The options of a scene that stepping changes while it works: no contacts to integrate, nothing else to detect."""

from __future__ import annotations

from types import TracebackType

import mujoco

from impactlaw.scene.tolerances import CCD_TOLERANCE

_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
_SMOOTH_OFF = _CONTACT | int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_SINGLE = int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
_EQUALITY, _LOSS = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY), int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
_LIMIT = int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_DENSE, _AUTO = int(mujoco.mjtJacobian.mjJAC_DENSE), int(mujoco.mjtJacobian.mjJAC_AUTO)
_SPARSE_FREEDOM = 60  # degrees of freedom from which MuJoCo's own choice of Jacobian is a sparse one
_CCD_ITERATIONS = 100


class BorrowedOptions:
    """Changes ``model.opt`` within a ``with`` block: what the user has set is read at its start and back at its end.

    Args:
        model: the scene.
        convex: whether pairs of geoms are measured by MuJoCo's general convex collider, which then is to be exact.
        limits: whether constraint rows are to tell which limits of joints and tendons are near.
        bilateral: whether equality constraints take part in collisions.

    Attributes:
        timestep: that the user has set, s.
        disabled: flags of what the user has disabled.
        enabled: flags of what the user has enabled.
        several: whether MuJoCo is to look for several contacts of faces, as the user has set.
        limited: whether limits are on, as the user has set. (Contacts that are off are not reported.)
    """

    def __init__(self, model: mujoco.MjModel, *, convex: bool, limits: bool, bilateral: bool = False):
        self._model = model
        self._convex = convex
        self._limits = limits
        self._bilateral = bilateral
        self._large = model.nv >= _SPARSE_FREEDOM

    def __enter__(self) -> BorrowedOptions:
        opt = self._opt = self._model.opt
        self.timestep = opt.timestep
        self.disabled, self.enabled = disabled, enabled = opt.disableflags, opt.enableflags
        self._kept = disabled, enabled, opt.o_margin
        self.several = not disabled & _SINGLE
        self.limited = not disabled & (_LIMIT | _CONSTRAINT)
        self._jacobian = opt.jacobian
        self._sparse = self._large if self._jacobian == _AUTO else self._jacobian != _DENSE
        self._smooth = disabled | _SMOOTH_OFF | _LIMIT, enabled & ~_SLEEP
        look = disabled | _SINGLE | _LOSS | _LIMIT | (0 if self._bilateral else _EQUALITY)
        if self._limits:
            look &= ~_LIMIT | disabled
            self._kept_margins = self._model.jnt_margin.copy(), self._model.tendon_margin.copy()
        self._look = look, (enabled | _OVERRIDE) & ~_SLEEP
        if self._convex:
            self._kept_ccd = opt.ccd_tolerance, opt.ccd_iterations
            opt.ccd_tolerance = min(opt.ccd_tolerance, CCD_TOLERANCE)
            opt.ccd_iterations = max(opt.ccd_iterations, _CCD_ITERATIONS)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        opt = self._opt
        opt.timestep = self.timestep
        opt.disableflags, opt.enableflags, opt.o_margin = self._kept
        if self._sparse:
            opt.jacobian = self._jacobian
        if self._convex:
            opt.ccd_tolerance, opt.ccd_iterations = self._kept_ccd
        if self._limits:
            self._model.jnt_margin[:], self._model.tendon_margin[:] = self._kept_margins
        del self._opt  # neither copied nor pickled

    def integrate(self, duration: float) -> None:
        """Let a step take ``duration`` s, without contacts."""
        opt = self._opt
        if duration != opt.timestep:
            opt.timestep = duration
        opt.disableflags, opt.enableflags = self._smooth
        if self._sparse:
            opt.jacobian = self._jacobian

    def look(self, within: float) -> None:
        """Let collision detection report the nearest contact of every pair closer than ``within`` m.

        Whatever margins the scene has. Constraint rows made meanwhile are those of equality constraints, limits and
        contacts, and dense.
        """
        opt = self._opt
        opt.disableflags, opt.enableflags = self._look
        opt.o_margin = within
        if self._sparse:
            opt.jacobian = _DENSE
        if self._limits:
            self._model.jnt_margin[:] = within
            self._model.tendon_margin[:] = within

    def look_for_several(self) -> None:
        """Let collision detection report several contacts of faces that meet."""
        self._opt.disableflags &= ~_SINGLE
