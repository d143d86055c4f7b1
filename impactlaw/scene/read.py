"""What a model and its state say about contact now; both are left as they are."""

from __future__ import annotations

import math
import numbers

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, InvalidCollisionError, OptionError, SceneError
from impactlaw.scene.contacts import Contacts, is_data_of, mass_matrix, update_positions
from impactlaw.scene.detection import Detector, Found
from impactlaw.scene.tolerances import GAP_TOLERANCE

_NOT_FINITE = "qpos or a pose of a mocap body is not finite"


def read_contacts(model: mujoco.MjModel, data: mujoco.MjData, *, within: float = GAP_TOLERANCE) -> Contacts:
    """Return the contacts whose gap is at most ``within`` now; model and data are left as they are.

    Args:
        model: the compiled scene.
        data: its state; only qpos, mocap poses and which equality constraints are active are read, so that stale
            derived quantities do not matter.
        within: largest gap reported, 0 or more, m, or rad for limits. Geoms that overlap are reported whatever it is.

    Raises:
        SceneError: a contact that is not between two geoms (a flex); or data is of another model.
        DivergenceError: a position is not finite.
        OptionError: within is no number of 0 or more.
    """
    _check_state(model, data)
    if not (isinstance(within, numbers.Real) and 0.0 <= float(within) < math.inf):
        raise OptionError(f"within is a gap of 0 m or more, got {within!r}")
    if not _finite(data):
        raise DivergenceError(f"{_NOT_FINITE} at t = {data.time:.6g} s: there are no contacts to read")
    return Detector(model).near(_position_copy(model, data), within).contacts


def read_closed(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, Found]:
    """Return the mass matrix, (nv, nv), and what is closed now, with equality constraints.

    Raises:
        SceneError: a contact that is not between two geoms (a flex); or data is of another model.
        InvalidCollisionError: a position is not finite.
    """
    _check_state(model, data)
    if not _finite(data):  # MuJoCo leaves contacts of such bodies out
        raise InvalidCollisionError(f"{_NOT_FINITE} at t = {data.time:.6g} s: there is no collision to read")
    scratch = _position_copy(model, data)
    near = Detector(model).near(scratch, GAP_TOLERANCE)
    return mass_matrix(model, scratch), near


def _check_state(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse what is no model and its state; numbers of another one would be put into too many places, or too few."""
    if not isinstance(model, mujoco.MjModel) or not isinstance(data, mujoco.MjData):
        kinds = f"{type(model).__name__} and {type(data).__name__}"
        raise SceneError(f"contacts are read from a mujoco.MjModel and its mujoco.MjData, got {kinds}")
    if not is_data_of(model, data):
        raise SceneError("data belongs to another model than the one it is given with")


def _finite(data: mujoco.MjData) -> bool:
    return all(np.isfinite(part).all() for part in (data.qpos, data.mocap_pos, data.mocap_quat))


def _position_copy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    scratch = mujoco.MjData(model)
    scratch.qpos[:] = data.qpos
    scratch.eq_active[:] = data.eq_active
    if model.nmocap:
        scratch.mocap_pos[:] = data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
    update_positions(model, scratch)
    return scratch
