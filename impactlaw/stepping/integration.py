"""Saving and restoring the state that MuJoCo's integrator starts from, what it adds to inertia, and checks of both."""

from __future__ import annotations

from math import inf
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, SceneError, UnfinishedStepError

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
STEP_STATE = _STATE & ~int(mujoco.mjtState.mjSTATE_USERDATA)
"""What a step in compiled code starts from: only callbacks use user data, of which some robots have megabytes."""
_HUGE = mujoco.mjMAXVAL  # MuJoCo treats larger numbers as a mistake
_EULER, _RK4, _IMPLICIT = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("EULER", "RK4", "IMPLICIT"))
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
NO_DAMPING = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
"""Flags that each keep Euler's integrator from implicit damping."""
_ROUNDING = 1e-9  # part of the inertia of a joint up to which added damping is rounding
_INPUT = ("time", "qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat")


def empty_state(model: mujoco.MjModel, kind: int = _STATE) -> np.ndarray:
    """Return an empty array for a state, or for the part of it that ``kind`` names."""
    return np.empty(mujoco.mj_stateSize(model, kind))


def save_state(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray | None = None) -> np.ndarray:
    """Return everything that the integrator starts from, in the given array if there is one."""
    state = empty_state(model) if state is None else state
    mujoco.mj_getState(model, data, state, _STATE)
    return state


def saved_qpos(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Return the positions in what `save_state` returned, (nq,)."""
    return state[1 : 1 + model.nq]  # the time comes first


def saved_qvel(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Return the velocities in what `save_state` returned, (nv,)."""
    return state[1 + model.nq : 1 + model.nq + model.nv]


def restore_state(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray, kind: int = _STATE) -> None:
    """Restore a state that `save_state` returned, or the part of one that ``kind`` names."""
    mujoco.mj_setState(model, data, state, kind)


def check_input(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> None:
    """Refuse input that MuJoCo would reset or ignore silently.

    Raises:
        DivergenceError: a position, velocity, activation, control, applied force, pose of a mocap body, or the time is
            not finite, or huge.
        SceneError: the timestep is not positive, or not finite.
    """
    check_finite(data, state)
    check_timestep(model.opt.timestep)


def check_finite(data: mujoco.MjData, state: np.ndarray) -> None:
    """Refuse a state, as saved, in which a number is not finite, or huge."""
    if not mujoco.mju_norm(state) <= _HUGE:
        for name in _INPUT:
            values = np.asarray(getattr(data, name))
            if values.size and not np.abs(values).max() <= _HUGE:
                raise DivergenceError(f"{name} is not finite, or huge, at t = {data.time:.6g} s")


def check_timestep(timestep: float) -> None:
    """Refuse a timestep that is not positive or not finite."""
    if not 0.0 < timestep < inf:
        raise SceneError(f"the timestep must be positive, got {timestep:g} s")


def is_huge(data: mujoco.MjData) -> bool:
    """Return whether a position or velocity is not finite, or so large that MuJoCo treats it as a mistake."""
    return not (mujoco.mju_norm(data.qpos) <= _HUGE and mujoco.mju_norm(data.qvel) <= _HUGE)


def check_speed(data: mujoco.MjData) -> None:
    """Refuse a velocity that is not finite, or so large that MuJoCo treats it as a mistake."""
    if not mujoco.mju_norm(data.qvel) <= _HUGE:  # numpy would warn of an overflow
        raise DivergenceError(
            f"the velocity is not finite, or huge, at t = {data.time:.6g} s; use a smaller timestep, or check "
            "the controls and the stiffness of the scene"
        )


def damps(model: mujoco.MjModel) -> bool:
    """Return whether a joint has damping that MuJoCo's Euler integrator advances implicitly."""
    return bool(
        np.count_nonzero(model.dof_damping)
        or np.count_nonzero(model.dof_dampingpoly)
        or (model.jnt_actuatorid != -1).any()
    )


def joint_inertia(model: mujoco.MjModel) -> np.ndarray | None:
    """Return ``h D`` of joint damping, which the integrator adds to M in a timestep h, (nv,); None if it adds nothing.

    This is the part of `implicit_inertia` that depends on the model only.
    """
    integrator = int(model.opt.integrator)
    off = model.opt.disableflags & (NO_DAMPING if integrator == _EULER else _NO_DAMPER)
    if integrator == _RK4 or off or not np.count_nonzero(model.dof_damping):
        return None
    return model.opt.timestep * model.dof_damping


def implicit_inertia(model: mujoco.MjModel, data: mujoco.MjData, duration: float, M: np.ndarray) -> np.ndarray | None:
    """Return the diagonal of ``tau D``, which MuJoCo's last step added to M, (nv,); None if it added nothing.

    MuJoCo's integrators advance by ``(M + tau D)^-1``, where D are derivatives of forces by velocity: Euler includes
    damping of joints, and the implicit integrators also include tendons, servos and drag. The result is computed from
    what the step left in data: the factor of the matrix, or D itself.

    Args:
        model: the scene.
        data: its state after `mj_step`.
        duration: duration tau of that step, s.
        M: a copy of ``data.M`` in that step.
    """
    integrator, off = int(model.opt.integrator), model.opt.disableflags
    if integrator == _RK4 or (integrator == _EULER and (off & NO_DAMPING or not damps(model))):
        return None
    if integrator == _IMPLICIT:
        added = -duration * data.qDeriv[model.D_rowadr + model.D_diag]
    elif not data.qHDiagInv.all():  # sleeping trees have made no step
        added = duration * model.dof_damping
    else:
        diagonal = model.M_rowadr + model.M_rownnz - 1
        squares = data.qH * data.qH
        squares[diagonal] = 1.0
        scale = np.repeat(1.0 / data.qHDiagInv, model.M_rownnz)
        added = np.bincount(model.M_colind, squares * scale, model.nv) - M[diagonal]
    added[added <= _ROUNDING * model.dof_M0] = 0.0
    return added if np.count_nonzero(added) else None


def locked_joints(model: mujoco.MjModel, added: np.ndarray | None, ratio: float) -> np.ndarray | None:
    """Return which degrees of freedom are all but locked by damping in a timestep h, bool (nv,); None if none are.

    These have ``h D > ratio M``, with h D from `implicit_inertia`. M is the smaller one of two inertias at the
    configuration in which the scene was compiled: with all other joints held, and with all others free to move. The
    latter is that of a light link between heavy ones, which a trunk of several joints in series has.

    MuJoCo's semi-implicit integrators advance by ``(M + h D)^-1``, but an impulse moves bodies by ``M^-1``. Where
    ``h D`` is many times M, the effect of contact on such a joint is gone after one step. Until then its damping is a
    force to which friction, welds and servos respond, and these can feed a motion that way.
    """
    if added is None:
        return None
    coupled = model.dof_simplenum == 0  # for others MuJoCo leaves armature out of the inverse
    locked = (added > ratio * model.dof_M0) | (coupled & (added * model.dof_invweight0 > ratio))
    return locked if np.count_nonzero(locked) else None


def no_room(data: mujoco.MjData, error: mujoco.FatalError) -> UnfinishedStepError:
    """Return an error for MuJoCo's memory that is too small, after releasing all that it has taken; raise any other."""
    if "out of memory" not in str(error):
        raise error
    world: Any = data
    world.pstack = world.pbase = world.parena = 0
    world.ncon = world.nefc = world.ne = world.nf = world.nl = 0
    return UnfinishedStepError(
        'MuJoCo has no room for all contacts; make <size memory="..."/> larger, or use scheme="time-stepping"'
    )
