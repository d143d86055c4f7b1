"""Directions of friction of MuJoCo's contacts: sliding, torsion and rolling, and their coefficients."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.contacts import Contacts
from impactlaw.surfaces import Surfaces, cross

MIN_FRICTION = 1e-10
"""Coefficient up to which there is no friction."""

_TORSION = 2  # rows of a contact are two of sliding, one of torsion, two of rolling


class Grip(NamedTuple):
    """Which rows of friction a sequence of contacts has, whatever the configuration is.

    Attributes:
        contact: index of the contact of each row, ascending, int (k,).
        kind: 0 and 1 for sliding, 2 for torsion, 3 and 4 for rolling, int (k,).
        coefficient: of each row: 1 for sliding, m for the others, (k,).
    """

    contact: np.ndarray
    kind: np.ndarray
    coefficient: np.ndarray


class Tangents(NamedTuple):
    """The rows of friction at one configuration.

    Attributes:
        grip: which rows they are.
        jacobian: ``J_t``, sliding in m/s, torsion and rolling in rad/s, (k, nv).
        drift: what moving surfaces add to these velocities, (k,).
    """

    grip: Grip
    jacobian: np.ndarray
    drift: np.ndarray


def pair_friction(model: mujoco.MjModel, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return dimensions, (h,), and coefficients, (h, 5), of contacts between pairs of geoms, (h, 2).

    MuJoCo's rule: an explicit pair has its own; else the geom of higher priority decides, else the larger value.
    """
    first, second = geoms.T
    ahead = model.geom_priority[first].astype(int) - model.geom_priority[second]
    one, other = model.geom_condim[first], model.geom_condim[second]
    dim = np.where(ahead > 0, one, np.where(ahead < 0, other, np.maximum(one, other)))
    mu1, mu2 = (model.geom_friction[geom][:, [0, 0, 1, 2, 2]] for geom in (first, second))
    ahead = ahead[:, None]
    mu = np.where(ahead > 0, mu1, np.where(ahead < 0, mu2, np.maximum(mu1, mu2)))
    for i in range(model.npair):
        pair = model.pair_geom1[i], model.pair_geom2[i]
        same = ((first == pair[0]) & (second == pair[1])) | ((first == pair[1]) & (second == pair[0]))
        dim[same], mu[same] = model.pair_dim[i], model.pair_friction[i]
    return dim, mu


def learn_grip(model: mujoco.MjModel, geoms: np.ndarray) -> Grip | None:
    """Return the rows of friction of contacts between these geoms, (h, 2); None if there are none."""
    dim, mu = pair_friction(model, geoms)
    rows = (np.arange(5) < dim[:, None] - 1) & (mu > MIN_FRICTION)
    if not rows.any():
        return None
    contact, kind = np.nonzero(rows)
    return Grip(contact, kind, mu[contact, kind])


def find_tangents(
    model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts, grip: Grip, surfaces: Surfaces | None
) -> Tangents:
    """Return the rows of friction of contacts at the current frames (`contacts.update_positions`).

    The directions are MuJoCo's: the second axis is the world's y, or z where the normal is near to that, made
    perpendicular.
    """
    contact, kind = grip.contact, grip.kind
    position = contacts.position[contact]
    slides = (kind < _TORSION)[:, None]
    axis = _axes(contacts.normal)[np.where(kind < _TORSION, kind + 1, kind - _TORSION), contact]
    force, torque = np.where(slides, axis, 0.0), np.where(slides, 0.0, axis)
    J = np.zeros((len(kind), model.nv))
    jacp, jacr = np.empty((2, 3, model.nv))
    bodies = model.geom_bodyid[contacts.geoms[contact]]
    for sign, body in ((-1.0, bodies[:, 0]), (1.0, bodies[:, 1])):
        for b in set(body.tolist()):
            if model.body_weldid[b] != 0:
                on = np.flatnonzero(body == b)
                mujoco.mj_jacBody(model, data, jacp, jacr, b)
                turned = cross(position[on] - data.xpos[b], force[on]) + torque[on]
                J[on] += sign * (force[on].dot(jacp) + turned.dot(jacr))
    drift = np.zeros(len(kind))
    if surfaces is not None:
        velocity, spin, belt = (part[contact] for part in surfaces.motion(data, contacts))
        drift = np.vecdot(force, velocity + belt) + np.vecdot(torque, spin)
    return Tangents(grip, J, drift)


def tangential_impulses(model: mujoco.MjModel, contacts: Contacts, friction_impulse: np.ndarray) -> np.ndarray:
    """Return the impulses of sliding friction on contacts that collided, world frame, N s, (h, 3).

    Args:
        model: the scene.
        contacts: that collided.
        friction_impulse: of all their rows of friction, (k,).
    """
    grip, impulse = learn_grip(model, contacts.geoms[contacts.geoms[:, 0] >= 0]), np.zeros((len(contacts), 3))
    if grip is not None:
        slides = grip.kind < _TORSION
        contact, kind = grip.contact[slides], grip.kind[slides]
        axes = _axes(contacts.normal)[kind + 1, contact]
        np.add.at(impulse, contact, axes * friction_impulse[slides, None])
    return impulse


def _axes(normal: np.ndarray) -> np.ndarray:
    """Return the axes of contacts, normals first, then two tangents, (3, h, 3)."""
    upright = np.abs(normal[:, 1]) >= 0.5
    second = np.zeros_like(normal)
    second[:, 1], second[:, 2] = ~upright, upright
    second -= np.vecdot(normal, second)[:, None] * normal
    second /= np.sqrt(np.vecdot(second, second))[:, None]
    return np.stack([normal, second, cross(normal, second)])
