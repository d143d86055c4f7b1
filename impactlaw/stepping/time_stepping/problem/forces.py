"""What a step leaves in data for sensors and readers: the forces of contact, and accelerations."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.stepping.time_stepping.problem.dense import encode_pyramids
from impactlaw.stepping.time_stepping.problem.rows import Rows

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


def write_forces(
    model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, cone: int, found: tuple[Rows, np.ndarray] | None
) -> None:
    """Let sensors and whoever reads ``efc_force`` and ``qfrc_constraint`` see the impulses of the step over h.

    Args:
        model: the scene.
        data: contacts those of the step, velocity that after it.
        start: velocity before the step, (nv,).
        cone: of friction that the user has chosen: readers decode forces by it.
        found: rows, and their impulses in units of the problem; None without contact.
    """
    force, h = np.zeros(data.nefc), model.opt.timestep
    if found is not None:
        rows, impulse = found
        force[rows.row] = rows.scale * impulse / h
    mujoco.mj_mulJacTVec(model, data, data.qfrc_constraint, force)
    data.qacc[:] = (data.qvel - start) / h
    if cone == _PYRAMIDAL and data.ncon:
        model.opt.cone = _PYRAMIDAL
        elliptic = data.contact.efc_address.copy()
        mujoco.mj_makeConstraint(model, data)
        contact = data.contact
        encode_pyramids(force, elliptic, contact.efc_address, contact.dim, contact.friction, data.efc_force)
    else:
        data.efc_force[:] = force


def sense(model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray) -> None:
    """Compute the sensors that depend on accelerations and forces, at the middle of the step."""
    after = data.qvel.copy()
    data.qvel[:] = start
    mujoco.mj_sensorAcc(model, data)
    data.qvel[:] = after
