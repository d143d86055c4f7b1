"""Reading of the current contacts from a model and its state, without changing them."""

from __future__ import annotations

import math
import numbers

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, InvalidCollisionError, OptionError, SceneError, instead_of
from impactlaw.scene.contacts import Contacts, is_data_of, mass_matrix, update_positions
from impactlaw.scene.detection import Detector, Found
from impactlaw.scene.friction_rows import FrictionRows, find_tangents, learn_friction
from impactlaw.scene.tolerances import GAP_TOLERANCE

_NOT_FINITE = "qpos or a pose of a mocap body is not finite"


def read_contacts(model: mujoco.MjModel, data: mujoco.MjData, *, within: float = GAP_TOLERANCE) -> Contacts:
    """Return the contacts whose gap is at most ``within`` now; model and data are not changed.

    Args:
        model: the compiled scene.
        data: its state; only qpos, mocap poses and the active flags of equality constraints are read, so that stale
            derived quantities do not matter.
        within: largest gap reported, 0 or more, m, or rad for limits. Geoms that overlap are always reported.

    Raises:
        SceneError: a contact is not between two geoms (a flex); or data belongs to another model.
        DivergenceError: a position is not finite.
        OptionError: within is not a number of at least 0.
    """
    _check_state(model, data)
    if not (isinstance(within, numbers.Real) and 0.0 <= float(within) < math.inf):
        raise OptionError(f"within is a gap of 0 m or more, got {within!r}")
    if not _finite(data):
        raise DivergenceError(f"{_NOT_FINITE} at t = {data.time:.6g} s: there are no contacts to read")
    return Detector(model).near(_position_copy(model, data), within).contacts


def read_closed(
    model: mujoco.MjModel, data: mujoco.MjData, *, friction: bool = False
) -> tuple[np.ndarray, Found, FrictionRows | None]:
    """Return the mass matrix, (nv, nv), the closed contacts with equality constraints, and friction if asked for.

    Raises:
        SceneError: a contact is not between two geoms (a flex); or data belongs to another model.
        InvalidCollisionError: a position is not finite, or the model has no degrees of freedom.
        OptionError: friction is not True or False.
    """
    _check_state(model, data)
    if model.nv == 0:
        raise InvalidCollisionError("the model has no degrees of freedom: no velocity can change in a collision")
    if not isinstance(friction, bool | np.bool_):
        raise OptionError(f"friction is True or False: whether to read the friction of contacts; got {friction!r}")
    if not _finite(data):  # MuJoCo would leave out the contacts of such bodies
        raise InvalidCollisionError(f"{_NOT_FINITE} at t = {data.time:.6g} s: there is no collision to read")
    scratch = _position_copy(model, data)
    near = Detector(model).near(scratch, GAP_TOLERANCE)
    return mass_matrix(model, scratch), near, _friction(model, scratch, near.contacts) if friction else None


def _friction(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> FrictionRows | None:
    of_geoms = contacts.geoms[contacts.geoms[:, 0] >= 0]
    pattern = learn_friction(model, of_geoms, len(contacts) - len(of_geoms), overridden=True)
    if pattern is None:
        return None
    J, drift = find_tangents(model, data, contacts, pattern, None)
    return FrictionRows(J, pattern.contact, pattern.coefficient, drift)


def _check_state(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise `SceneError` unless data is the state of the model; the arrays of another model may differ in size."""
    if not isinstance(model, mujoco.MjModel) or not isinstance(data, mujoco.MjData):
        kinds = f"{type(model).__name__} and {type(data).__name__}{instead_of(model)}"
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
