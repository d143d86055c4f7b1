"""Find what may hold the joints of a scene still under rigid contact, where MuJoCo's own contacts would give way."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import product
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import HeldJointsWarning
from impactlaw.scene.contacts import geom_names

_DEEP = 1e-3  # m; smaller overlaps are mostly opened
_LEVER = 1e-3  # m, and m/m; gradient of a gap below which a push at the contact moves no joint
_FEW = 2  # number of degrees of freedom between two links up to which perhaps no motion opens their overlap
_NAMED = 3  # number of things that a line names
_FIXED, _AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)
_NO_BIAS = int(mujoco.mjtBias.mjBIAS_NONE)
_JOINTS = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def warn_of_held_joints(model: mujoco.MjModel, *, stacklevel: int) -> None:
    """Warn of everything that `cautions` returns."""
    for caution in cautions(model):
        warnings.warn(caution, HeldJointsWarning, stacklevel=stacklevel)


def cautions(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return one line for each reason why joints of the scene may be held still under rigid time stepping."""
    return *_overlaps(model), *_weak_servos(model)


def _overlaps(model: mujoco.MjModel) -> Iterator[str]:
    """Yield a line if links of one mechanism overlap at the start of the scene: perhaps no motion can open them."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    try:
        mujoco.mj_collision(model, data)
    except mujoco.FatalError:  # no memory for so many contacts; the steps report that
        return
    deepest: dict[tuple[int, int], float] = {}
    for contact in data.contact:
        one, other = map(int, contact.geom)
        if contact.dist >= -_DEEP or min(one, other) < 0:
            continue
        bodies = model.geom_bodyid[[one, other]]
        if _are_linked(model, *bodies) and _turns(model, data, contact, *bodies):
            deepest[one, other] = max(deepest.get((one, other), 0.0), -contact.dist)
    if deepest:
        names, pairs = geom_names(model), sorted(deepest, key=lambda pair: -deepest[pair])
        told = ", ".join(f"{names[a]}/{names[b]} by {1e3 * deepest[a, b]:.2g} mm" for a, b in pairs[:_NAMED])
        yield (
            f"links of one mechanism overlap: {told}{_others(len(pairs))}; where no motion opens that, they hold each "
            "other: leave out their collisions, by <exclude> or contype and conaffinity"
        )


def _are_linked(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Return whether two bodies of one mechanism have a few degrees of freedom between them, but at least one."""
    if model.body_rootid[one] != model.body_rootid[other] or model.body_rootid[one] == 0:
        return False
    count = 0
    while one != other:  # the parent has the smaller number
        count += int(model.body_dofnum[max(one, other)])
        one, other = min(one, other), int(model.body_parentid[max(one, other)])
    return 1 <= count <= _FEW


def _turns(model: mujoco.MjModel, data: mujoco.MjData, contact: Any, one: int, other: int) -> bool:
    """Return whether a push at a contact can move a joint.

    It cannot where limbs overlap in the axis or the center of the joint that connects them.
    """
    jacobian = np.zeros((2, 3, model.nv))
    for body, rows in zip((one, other), jacobian, strict=True):
        mujoco.mj_jac(model, data, rows, None, contact.pos, body)
    return bool(np.abs(contact.frame[:3] @ (jacobian[1] - jacobian[0])).max() > _LEVER)


def _weak_servos(model: mujoco.MjModel) -> Iterator[str]:
    """Yield a line if actuators of joints are weaker than the dry friction of these joints, which is exact here."""
    weak: list[str] = []
    for joint in range(model.njnt):
        loss = float(model.dof_frictionloss[model.jnt_dofadr[joint]])
        if loss == 0.0 or model.jnt_type[joint] not in (_HINGE, _SLIDE):
            continue
        moves = np.isin(model.actuator_trntype, _JOINTS) & (model.actuator_trnid[:, 0] == joint)
        most = sum(_strongest(model, i, joint) for i in np.flatnonzero(moves))
        if moves.any() and most < loss:
            weak.append(f"{model.joint(joint).name or joint} ({most:.2g} of {loss:.2g})")
    if weak:
        yield (
            "actuators cannot overcome the frictionloss of their joints, which is exact: "
            f'{", ".join(weak[:_NAMED])}{_others(len(weak))}; take contact_model="soft", or a smaller frictionloss'
        )


def _strongest(model: mujoco.MjModel, actuator: np.intp, joint: int) -> float:
    """Return the largest force of an actuator on its joint, N or N m; infinite if it is not known."""
    control_at, force_at = model.actuator_ctrladr[actuator], model.actuator_outadr[actuator]
    gear, limit = abs(float(model.actuator_gear[force_at, 0])), np.inf
    if model.actuator_forcelimited[actuator]:
        limit = float(np.abs(model.actuator_forcerange[actuator]).max())
    bias: Any = model.actuator_biasprm[actuator] if model.actuator_biastype[actuator] == _AFFINE else np.zeros(3)
    known = model.actuator_gaintype[actuator] == _FIXED and model.actuator_biastype[actuator] in (_AFFINE, _NO_BIAS)
    ranged = bool(model.jnt_limited[joint]) or bias[1] == 0.0
    if known and ranged and model.actuator_ctrllimited[control_at] and bias[2] == 0.0:
        positions = model.jnt_range[joint] if model.jnt_limited[joint] else np.zeros(1)
        gain = model.actuator_gainprm[actuator, 0]
        extremes = product(model.actuator_ctrlrange[control_at], positions)
        forces = [gain * control + bias[0] + bias[1] * gear * position for control, position in extremes]
        limit = min(limit, float(np.abs(forces).max()))
    return gear * limit


def _others(count: int) -> str:
    """Return how many more items there are than a line names."""
    return f", and {count - _NAMED} more" if count > _NAMED else ""
