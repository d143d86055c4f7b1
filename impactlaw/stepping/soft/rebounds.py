"""Contacts of MuJoCo that bounce by themselves, beside a law that decides how colliding bodies separate.

A contact with a damping ratio below 1 is a spring that throws back bodies that have sunk in; this is how MuJoCo models
restitution. A collision is detected after bodies have sunk in, so that the spring would add its rebound to the velocity
that the law gives. A contact of this kind that does not close may therefore push bodies apart to at most
``rest_speed``. If MuJoCo's solver would push harder, the reference acceleration is reduced accordingly, but at most by
the part of the spring, so that the damping stays. A contact under load, as in a grip, moves no body and is left alone.
Limits of joints and tendons count as contacts here.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.contacts import acted_on, active_contacts, row_velocities, sorted_geoms
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.soft.tolerances import STILL, UNDERDAMPED

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


def bounces(data: mujoco.MjData) -> bool:
    """Return whether a contact or limit that MuJoCo's solver acts on is an underdamped spring."""
    first = data.ne + data.nf
    if data.nefc == first:
        return False
    stiffness, damping = data.efc_KBIP.reshape(-1, 4)[first : data.nefc, :2].T
    return bool((damping * damping < UNDERDAMPED * 4.0 * stiffness).any())


def hold_back(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    names: tuple[str, ...],
    limits: Limits,
    *,
    rest_speed: float,
    chosen: Chosen | None,
    surfaces: Surfaces | None,
) -> bool:
    """Reduce the reference accelerations ``data.efc_aref`` of contacts that would rebound; return whether any is.

    The velocities of the rows, and the accelerations without this reduction, must be current. A single contact with
    impedance d has the acceleration ``a = d aref + (1 - d) a0``, where a0 is its acceleration without contact force.

    Args:
        model: the scene.
        data: its state.
        names: names of geoms.
        limits: the limits of joints and tendons.
        rest_speed: largest speed to which these contacts may push, m/s or rad/s.
        chosen: the contacts to which the law applies; None for all.
        surfaces: moving mocap bodies; None if there are none.
    """
    rows, labels, drift = normals(model, data, names, limits, surfaces)
    pair = np.where(are_pairs(model, data, rows), rows + 1, rows)
    gamma = 0.5 * (data.efc_vel[rows] + data.efc_vel[pair])
    stiffness, damping, impedance = data.efc_KBIP.reshape(-1, 4)[rows, :3].T
    reached = row_velocities(model, data, data.qacc)
    most = np.maximum((rest_speed - gamma - drift) / model.opt.timestep, -damping * gamma)
    spring = 0.5 * (data.efc_aref[rows] + data.efc_aref[pair]) + damping * gamma
    above = 0.5 * (reached[rows] + reached[pair]) - most
    excess = np.minimum(above / np.maximum(impedance, mujoco.mjMINIMP), spring)
    held = (damping * damping < UNDERDAMPED * 4.0 * stiffness) & (gamma + drift > -STILL) & (excess > 0.0)
    if chosen is not None:
        held &= chosen.mask(labels)
    for i in np.flatnonzero(held):
        count = 2 * (data.contact.dim[data.efc_id[rows[i]]] - 1) if pair[i] > rows[i] else 1
        data.efc_aref[rows[i] : rows[i] + count] -= excess[i]
    return bool(held.any())


def normals(
    model: mujoco.MjModel, data: mujoco.MjData, names: tuple[str, ...], limits: Limits, surfaces: Surfaces | None
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Return the first row, label and surface velocity of each limit and contact that MuJoCo's solver acts on."""
    first, found = data.ne + data.nf, data.contact
    limit_rows = np.arange(first, first + data.nl)
    labels = tuple(limits.labels[limits.code(data, row)] for row in limit_rows.tolist())
    index = acted_on(data)
    if not len(index):
        return limit_rows, labels, np.zeros(data.nl)
    contacts = active_contacts(model, data, names)
    address = found.efc_address[index[sorted_geoms(found.geom[index])[1]]]
    drift = np.zeros(len(contacts)) if surfaces is None else surfaces.drift(data, contacts)
    return (
        np.concatenate([limit_rows, address]),
        labels + contacts.labels,
        np.concatenate([np.zeros(data.nl), drift]),
    )


def are_pairs(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
    """Return which of these first rows begin a pyramid, bool; its normal is the mean of its first two rows."""
    pairs = np.zeros(len(rows), dtype=bool)
    if model.opt.cone == _PYRAMIDAL and data.ncon:
        pairs[data.nl :] = data.contact.dim[data.efc_id[rows[data.nl :]]] > 1
    return pairs
