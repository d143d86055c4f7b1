"""Sensors of time steps, and what MuJoCo computes between them."""

from __future__ import annotations

from collections.abc import Callable

import mujoco

from impactlaw.compiled import for_python
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.time_stepping.tolerances import LEAST

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


def listed_stage(model: mujoco.MjModel) -> int:
    """Return the last stage, before that of forces, in which sensors read the list of contacts; 0 if none do."""
    of_contacts = model.sensor_needstage[model.sensor_type == _CONTACT]
    return int(of_contacts[of_contacts < _ACC].max(initial=0))


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
