"""Contacts of MuJoCo that bounce by themselves, beside a law that decides how colliding bodies separate.

A contact with a damping ratio below 1 is a spring that throws back bodies that have sunk in; this is how MuJoCo models
restitution. A collision is detected after bodies have sunk in, so that the spring would add its rebound to the velocity
that the law gives. A contact of this kind that does not close may therefore push bodies apart to at most
``rest_speed``. If MuJoCo's solver would push harder, the reference acceleration is reduced accordingly, but at most by
the part of the spring, so that the damping stays. A contact under load, as in a grip, moves no body and is left alone.
Limits of joints and tendons count as contacts here.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.contacts import acted_on, active_contacts, row_velocities
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.soft.tolerances import STILL, UNDERDAMPED

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


class Normals(NamedTuple):
    """The limits and contacts that MuJoCo's solver acts on, and their normal rows."""

    row: np.ndarray  # first row of MuJoCo's, int (h,)
    pair: np.ndarray  # the second row if the contact is a pyramid, whose normal is the mean of both; else the first
    drift: np.ndarray  # velocities due to moving surfaces, m/s, (h,)
    chosen: np.ndarray  # whether the law is for them, bool (h,)

    def of(self, rows: np.ndarray) -> np.ndarray:
        """Return the numbers of normals, (h,), from those of MuJoCo's rows, (nefc,)."""
        return 0.5 * (rows[self.row] + rows[self.pair])


def bounces(data: mujoco.MjData) -> bool:
    """Return whether a contact or limit that MuJoCo's solver acts on is an underdamped spring."""
    first = data.ne + data.nf
    if data.nefc == first:
        return False
    stiffness, damping = data.efc_KBIP.reshape(-1, 4)[first : data.nefc, :2].T
    return bool((damping * damping < UNDERDAMPED * 4.0 * stiffness).any())


def hold_back(model: mujoco.MjModel, data: mujoco.MjData, found: Normals, rest_speed: float) -> bool:
    """Reduce the reference accelerations ``data.efc_aref`` of contacts that would rebound; return whether any is.

    The velocities of the rows, and the accelerations without this reduction, must be current. A single contact with
    impedance d has the acceleration ``a = d aref + (1 - d) a0``, where a0 is its acceleration without contact force.

    Args:
        model: the scene.
        data: its state.
        found: the contacts and limits.
        rest_speed: largest speed to which these contacts may push, m/s or rad/s.
    """
    rows, pair, drift, chosen = found
    gamma, reached = found.of(data.efc_vel), row_velocities(model, data, data.qacc)
    stiffness, damping, impedance = data.efc_KBIP.reshape(-1, 4)[rows, :3].T
    most = np.maximum((rest_speed - gamma - drift) / model.opt.timestep, -damping * gamma)
    spring = found.of(data.efc_aref) + damping * gamma
    excess = np.minimum((found.of(reached) - most) / np.maximum(impedance, mujoco.mjMINIMP), spring)
    held = chosen & (damping * damping < UNDERDAMPED * 4.0 * stiffness) & (gamma + drift > -STILL) & (excess > 0.0)
    for i in np.flatnonzero(held):
        count = 2 * (data.contact.dim[data.efc_id[rows[i]]] - 1) if pair[i] > rows[i] else 1
        data.efc_aref[rows[i] : rows[i] + count] -= excess[i]
    return bool(held.any())


def normals(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    names: tuple[str, ...],
    limits: Limits,
    chosen: Chosen | None,
    surfaces: Surfaces | None,
) -> Normals:
    """Return the normal rows of limits and contacts.

    Args:
        model: the scene.
        data: its state.
        names: names of geoms.
        limits: the limits of joints and tendons.
        chosen: the contacts to which the law applies; None for all.
        surfaces: moving mocap bodies; None if there are none.
    """
    first, found, index = data.ne + data.nf, data.contact, acted_on(model, data)
    rows = np.arange(first, first + data.nl)
    labels = tuple(limits.labels[limits.code(data, row)] for row in rows.tolist())
    pair, drift = rows, np.zeros(data.nl)
    if len(index):
        contacts, address = active_contacts(model, data, names), found.efc_address[index]
        paired = (model.opt.cone == _PYRAMIDAL) & (found.dim[index] > 1)
        rows, pair = np.concatenate([rows, address]), np.concatenate([rows, address + paired])
        moved = np.zeros(len(contacts)) if surfaces is None else surfaces.drift(data, contacts)
        labels, drift = labels + contacts.labels, np.concatenate([drift, moved])
    return Normals(rows, pair, drift, np.ones(len(rows), dtype=bool) if chosen is None else chosen.mask(labels))
