"""RK4 for soft steps that end in a collision: its stages must not feel a contact that is not closed yet."""

from __future__ import annotations

import mujoco
import numpy as np

SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
"""Flag with which trees can sleep."""
_READ = "qacc", "act_dot", "M", "qfrc_smooth", "qfrc_constraint"  # RK4 reads the first two
BODY = int(mujoco.mjtTrn.mjTRN_BODY)
"""Transmission of actuators that pull at contacts."""
NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""Flags with which neither contacts nor limits act."""
NO_LIMIT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""Flags each of which disables limits."""
TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
"""Type of the constraint rows of limits of tendons."""
SCALAR = int(mujoco.mjtJoint.mjJNT_SLIDE)
"""First type of joint with one degree of freedom; slides and hinges come last."""


def keep_start(data: mujoco.MjData, *, touches: bool) -> tuple[np.ndarray, ...]:
    """Return the results of `mj_forward` that `advance_without_new_contacts` reads, besides the state."""
    if touches or mujoco.get_mjcb_control() is not None:
        return tuple(getattr(data, name).copy() for name in _READ)
    return data.qacc.copy(), data.act_dot.copy()


def put_start(data: mujoco.MjData, start: tuple[np.ndarray, ...]) -> None:
    """Write the results of `keep_start` into data; this suffices for a step only if `is_plain`."""
    for name, value in zip(_READ, start, strict=False):
        getattr(data, name)[:] = value


def is_plain(model: mujoco.MjModel) -> bool:
    """Return whether integrators read only these results: no histories of sensors, no plugins, no sleeping trees."""
    return not (model.nhistory or model.nplugin or model.opt.enableflags & SLEEP)


def passes_limit(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a slide or hinge that is within its limits will pass one in this step, ``q + h v + h^2 a / 2``.

    Then the step will most likely end in a collision, and is taken without new contacts at once.
    """
    if model.opt.disableflags & NO_LIMIT:
        return False
    scalar = (model.jnt_type >= SCALAR) & (model.jnt_limited != 0)
    place, dof, h = model.jnt_qposadr[scalar], model.jnt_dofadr[scalar], model.opt.timestep
    ends, margin = model.jnt_range[scalar], model.jnt_margin[scalar]
    now, moved = data.qpos[place], h * (data.qvel[dof] + 0.5 * h * data.qacc[dof])
    lower, upper = now - ends[:, 0] - margin, ends[:, 1] - now - margin
    passed = ((lower >= 0.0) & (lower + moved < 0.0)) | ((upper >= 0.0) & (upper - moved < 0.0))
    return bool(np.count_nonzero(passed))


def contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the generalized forces of the current contacts and limits, (nv,)."""
    forces, found = data.efc_force.copy(), np.zeros(model.nv)
    forces[: data.ne + data.nf] = 0.0
    mujoco.mj_mulJacTVec(model, data, found, forces)
    return found


def _needs_contacts(model: mujoco.MjModel) -> bool:
    """Return whether other forces act through contacts, or trees can sleep."""
    pulls = model.flg_adhesion or (model.actuator_trntype == BODY).any()
    return bool(pulls or model.opt.enableflags & SLEEP)


def advance_without_new_contacts(model: mujoco.MjModel, data: mujoco.MjData, *, pushing: np.ndarray | None) -> None:
    """Advance as RK4 does after `mj_forward`, but without contacts that do not act at the start of the step.

    In the stages of RK4 such contacts would take up to half of the speed that the law is to reverse. Contacts and
    limits are disabled in the stages; those that act at the start keep their forces. Euler, whose forces are those of
    the start, takes the step with a control callback, which RK4 would call again, and if something touches in a scene
    with adhesion or sleeping trees.

    Args:
        model: the scene.
        data: the state after `mj_forward`.
        pushing: the `contact_forces` at the start; None if no contact or limit touches there.
    """
    if mujoco.get_mjcb_control() is not None or (pushing is not None and _needs_contacts(model)):
        mujoco.mj_Euler(model, data)
        return
    options, applied = model.opt, data.qfrc_applied.copy()
    flags = options.disableflags
    options.disableflags = flags | NO_CONTACT
    if pushing is not None:
        data.qfrc_applied += pushing
    try:
        mujoco.mj_RungeKutta(model, data, 4)
    finally:
        options.disableflags = flags
        data.qfrc_applied[:] = applied
