"""What a model and its state say about contact now; both are left as they are."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError
from impactlaw.scene.contacts import Contacts, mass_matrix, update_positions
from impactlaw.scene.detection import Detector, Found
from impactlaw.scene.tolerances import GAP_TOLERANCE


def read_contacts(model: mujoco.MjModel, data: mujoco.MjData, *, within: float = GAP_TOLERANCE) -> Contacts:
    """Return the contacts whose gap is at most ``within`` now; model and data are left as they are.

    Args:
        model: the compiled scene.
        data: its state; only qpos and mocap poses are read, so that stale derived quantities do not matter.
        within: largest gap reported, m, or rad for limits. Geoms that overlap are reported whatever it is.

    Raises:
        SceneError: a contact that is not between two geoms (a flex).
        DivergenceError: a position is not finite.
    """
    if not np.isfinite(data.qpos).all():
        raise DivergenceError(f"qpos is not finite at t = {data.time:.6g} s: there are no contacts to read")
    return Detector(model).near(_position_copy(model, data), within).contacts


def read_closed(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, Found]:
    """Return the mass matrix, (nv, nv), and what is closed now, with equality constraints.

    Raises:
        SceneError: a contact that is not between two geoms (a flex).
    """
    scratch = _position_copy(model, data)
    near = Detector(model).near(scratch, GAP_TOLERANCE)
    return mass_matrix(model, scratch), near


def _position_copy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    scratch = mujoco.MjData(model)
    scratch.qpos[:] = data.qpos
    scratch.eq_active[:] = data.eq_active
    if model.nmocap:
        scratch.mocap_pos[:] = data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
    update_positions(model, scratch)
    return scratch
