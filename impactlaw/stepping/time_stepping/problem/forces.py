"""Write the forces of contact and the accelerations of a step into data, for sensors and other readers."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.lib.stride_tricks import as_strided

from impactlaw.compiled import for_python
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.dense import encode_pyramids, leave_open_out
from impactlaw.stepping.time_stepping.margins import LEAST
from impactlaw.stepping.time_stepping.problem.rows import Rows

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
_CONTACT = int(mujoco.mjtSensor.mjSENS_CONTACT)
_POS, _VEL, _ACC = int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL), int(mujoco.mjtStage.mjSTAGE_ACC)
_JOINT_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_TENDON_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)


@plain
def hide_limits(kinds, ids, position, margin):
    """Hide limits that are far away from MuJoCo's sensors, or show them again; rows include all limits, near or not.

    Sensors of limits take the first row with the number of their joint or tendon, and its gap beyond its margin.
    """
    for r in range(len(kinds)):
        if kinds[r] == _JOINT_LIMIT or kinds[r] == _TENDON_LIMIT:
            margin[r] = 0.0
            if position[r] > LEAST:
                ids[r] = -1 - ids[r]


def without_far_limits(
    sensors: Callable[[mujoco.MjModel, mujoco.MjData], None], model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    """Compute the sensors of a stage by MuJoCo, as if limits that are far away did not exist."""
    rows = data.efc_type, data.efc_id, data.efc_pos, data.efc_margin
    for_python(hide_limits)(*rows)
    sensors(model, data)
    for_python(hide_limits)(*rows)


def write_forces(
    model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, cone: int, found: tuple[Rows, np.ndarray] | None
) -> None:
    """Write the impulses of the step over h to ``efc_force`` and ``qfrc_constraint``, for sensors and other readers.

    Args:
        model: the scene.
        data: its state, with the contacts of the step and the velocity after it.
        start: velocity before the step, (nv,).
        cone: kind of friction cone that the user has chosen; readers decode forces by it.
        found: the rows, and their impulses in units of the problem; None without contact.
    """
    force, h = np.zeros(data.nefc), model.opt.timestep
    if found is not None:
        rows, impulse = found
        force[rows.row] = rows.scale * impulse / h
    mujoco.mj_mulJacTVec(model, data, data.qfrc_constraint, force)
    data.qacc[:] = (data.qvel - start) / h
    data.efc_force[:] = force
    if data.ncon:
        contact, each = data.contact, data.contact.dist.strides[0]
        first = contact.dist[:1].view(np.int32)  # distance is the first field of a contact
        whole = as_strided(first, (data.ncon, each // 4), (each, 4))
        data.ncon = leave_open_out(force, contact.dist, LEAST, contact.dim, contact.efc_address, whole, data.efc_id)
    if not data.ncon or cone != _PYRAMIDAL:
        return
    model.opt.cone, elliptic = _PYRAMIDAL, data.contact.efc_address.copy()
    mujoco.mj_makeConstraint(model, data)
    contact = data.contact
    encode_pyramids(force, elliptic, contact.efc_address, contact.dim, contact.friction, data.efc_force)


def listed_stage(model: mujoco.MjModel) -> int:
    """Return the last stage, before that of forces, in which sensors read the list of contacts; 0 if none do."""
    of_contacts = model.sensor_needstage[model.sensor_type == _CONTACT]
    return int(of_contacts[of_contacts < _ACC].max(initial=0))


def sense(model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, listed: int) -> None:
    """Compute the sensors that depend on accelerations and forces, at the middle of the step.

    Those that depend on the list of contacts are computed again, since it is shorter now (`listed_stage`).
    """
    after = data.qvel.copy()
    data.qvel[:] = start
    mujoco.mj_comVel(model, data)
    if listed >= _POS:
        without_far_limits(mujoco.mj_sensorPos, model, data)
    if listed >= _VEL:
        without_far_limits(mujoco.mj_sensorVel, model, data)
    without_far_limits(mujoco.mj_sensorAcc, model, data)
    data.qvel[:] = after


_POSITION = (
    *(mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_tendon, mujoco.mj_makeM, mujoco.mj_factorM),
    mujoco.mj_transmission,
)
"""What MuJoCo computes for positions, without contacts."""


def forward_keeping_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Do what `mj_step1` does after a rigid step, except that contacts, rows and forces remain those of the step.

    MuJoCo would look for contacts again with the margins of the scene, and find few: bodies at rest have gaps of 0 up
    to rounding, and those that bounce have never overlapped.
    """
    mujoco.mj_checkPos(model, data)
    mujoco.mj_checkVel(model, data)
    data.flg_energypos = False
    for update in _POSITION:
        update(model, data)
    without_far_limits(mujoco.mj_sensorPos, model, data)
    mujoco.mj_fwdVelocity(model, data)
    without_far_limits(mujoco.mj_sensorVel, model, data)
    if model.opt.enableflags & _ENERGY:
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
    control = mujoco.get_mjcb_control()
    if control is not None:
        control(model, data)
