"""Temporary changes of a scene's options: smooth phases integrate without contacts, detection reads only contacts."""

from __future__ import annotations

import mujoco

from impactlaw.scene.collide import CorrectedGeoms, present
from impactlaw.scene.joint_limits import slack_ropes
from impactlaw.scene.tolerances import CCD_TOLERANCE, NEVER

_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
_SMOOTH_OFF = _CONTACT | int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_SINGLE = int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
_EQUALITY, _LOSS = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY), int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
_LIMIT = int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_DENSE, _AUTO = int(mujoco.mjtJacobian.mjJAC_DENSE), int(mujoco.mjtJacobian.mjJAC_AUTO)
_SPARSE_FREEDOM = 60  # degrees of freedom from which MuJoCo's automatic choice is a sparse Jacobian
_CCD_ITERATIONS = 100


class BorrowedOptions:
    """A ``with`` block in which ``model.opt`` may be changed; the user's options are saved and restored.

    Args:
        model: the scene.
        corrected: the geoms of the scene whose contacts are to be corrected.
        convex: whether MuJoCo's general convex collider measures pairs of geoms; its tolerance is then tightened.
        limits: whether near limits of joints and tendons are to be read from constraint rows.
        bilateral: whether equality constraints take part in collisions.

    Attributes:
        timestep: the user's time step, s.
        disabled: the user's disable flags.
        enabled: the user's enable flags.
        integrator: the user's integrator.
        several: whether the user lets MuJoCo look for several contacts between faces.
        limited: whether the user has limits on. (If contacts are off, detection reports none.)
        corrected: those of these geoms that can be in contact now.
        stands: whether some cylinders can stand on planes.
    """

    def __init__(
        self, model: mujoco.MjModel, corrected: CorrectedGeoms | None, *, convex: bool, limits: bool, bilateral: bool
    ):
        self._model, self._all_corrected = model, corrected
        self._masks: tuple[bytes, bytes] = b"", b""  # masks of geoms that the next two attributes are for
        self.corrected, self.stands = None, False
        self._convex = convex
        self._limits = limits
        self._bilateral = bilateral
        self._large = model.nv >= _SPARSE_FREEDOM

    def __enter__(self) -> BorrowedOptions:
        opt = self._opt = self._model.opt
        self.timestep, self.integrator = opt.timestep, opt.integrator
        self.disabled, self.enabled = disabled, enabled = opt.disableflags, opt.enableflags
        self._kept = disabled, enabled, opt.o_margin
        self.several = not disabled & _SINGLE
        self.limited = not disabled & (_LIMIT | _CONSTRAINT)
        if self._all_corrected is not None:
            masks = self._model.geom_contype.tobytes(), self._model.geom_conaffinity.tobytes()
            if masks != self._masks:  # the first time, or they were changed
                self._masks = masks
                self.corrected, self.stands = present(self._model, self._all_corrected)
        self._jacobian = opt.jacobian
        self._sparse = self._large if self._jacobian == _AUTO else self._jacobian != _DENSE
        self._smooth = disabled | _SMOOTH_OFF | _LIMIT, enabled & ~_SLEEP
        look = disabled | _SINGLE | _LOSS | _LIMIT | (0 if self._bilateral else _EQUALITY)
        if self._limits:
            look &= ~_LIMIT | disabled
            self._kept_margins = self._model.jnt_margin.copy(), self._model.tendon_margin.copy()
            self._kept_ranges = self._model.tendon_range.copy()
            self._model.tendon_range[slack_ropes(self._model), 0] = NEVER
        self._look = look, (enabled | _OVERRIDE) & ~_SLEEP
        if self._convex:
            self._kept_ccd = opt.ccd_tolerance, opt.ccd_iterations
            opt.ccd_tolerance = min(opt.ccd_tolerance, CCD_TOLERANCE)
            opt.ccd_iterations = max(opt.ccd_iterations, _CCD_ITERATIONS)
        return self

    def __exit__(self, *_: object) -> None:
        opt = self._opt
        opt.timestep = self.timestep
        opt.disableflags, opt.enableflags, opt.o_margin = self._kept
        if self._sparse:
            opt.jacobian = self._jacobian
        if self._convex:
            opt.ccd_tolerance, opt.ccd_iterations = self._kept_ccd
        if self._limits:
            self._model.jnt_margin[:], self._model.tendon_margin[:] = self._kept_margins
            self._model.tendon_range[:] = self._kept_ranges
        del self._opt  # cannot be copied or pickled

    def integrate(self, duration: float) -> None:
        """Set the options for a step of ``duration`` s without contacts."""
        opt = self._opt
        if duration != opt.timestep:
            opt.timestep = duration
        opt.disableflags, opt.enableflags = self._smooth
        if self._sparse:
            opt.jacobian = self._jacobian

    def look(self, within: float, *, several: bool = False) -> None:
        """Set the options for detection of the nearest contact of every pair of geoms closer than ``within`` m.

        With ``several``, all contacts between faces are detected.

        The margins of the scene do not matter. Constraint rows made with these options are dense, and are those of
        equality constraints, limits and contacts only.
        """
        opt = self._opt
        opt.disableflags, opt.enableflags = self._look
        if several:
            opt.disableflags &= ~_SINGLE
        opt.o_margin = within
        if self._sparse:
            opt.jacobian = _DENSE
        if self._limits:
            self._model.jnt_margin[:] = within
            self._model.tendon_margin[:] = within
