"""Contacts with all that an impulse on them needs, and what an impulse does, by MuJoCo's sparse factor of the inertia.

MuJoCo factors ``M = L^T D L``, so that here ``R^T = D^1/2 L``: ``|R^T v|`` is the kinetic metric, and
``Y = J R^-T`` has ``Y Y^T = G`` (`impactlaw.metric`). All functions want current frames and inertia
(`impactlaw.contacts.update_positions`); those that use the factor want a `look` before them.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.contacts import Contacts, contact_rows, gap_gradients
from impactlaw.detection import Detector, Pattern
from impactlaw.flow import Frames


class Touch(NamedTuple):
    """Contacts near each other or closed, at one configuration.

    Attributes:
        pattern: what their geoms say.
        contacts: the contacts.
        jacobian: gap gradients ``J``, (h, nv).
        gradients: ``Y``, the same where the kinetic metric is Euclidean, (h, nv).
        lengths: of the rows of Y, (h,).
        frames: of all geoms.
    """

    pattern: Pattern
    contacts: Contacts
    jacobian: np.ndarray
    gradients: np.ndarray
    lengths: np.ndarray
    frames: Frames


def look(model: mujoco.MjModel, data: mujoco.MjData, detector: Detector, within: float) -> Touch:
    """Return the contacts nearer than ``within``, m, and perhaps more; factors the inertia where there are any."""
    pattern, contacts = detector.find(data, within)
    if not pattern:
        none = np.zeros((0, model.nv))
        return Touch(pattern, contacts, none, none, np.zeros(0), Frames.of(data))
    J = None if pattern.several else contact_rows(model, data)
    if J is None:
        J = gap_gradients(model, data, contacts)
    elif pattern.order is not None:
        J = J[pattern.order]
    mujoco.mj_factorM(model, data)
    Y = whiten_gradients(model, data, J)
    return Touch(pattern, contacts, J, Y, np.sqrt(np.vecdot(Y, Y)), Frames.of(data))


def whiten_gradients(model: mujoco.MjModel, data: mujoco.MjData, jacobian: np.ndarray) -> np.ndarray:
    """Return ``J R^-T``, (h, nv)."""
    Y = np.empty_like(jacobian)
    mujoco.mj_solveM2(model, data, Y, jacobian, np.sqrt(data.qLDiagInv))
    return Y


def whiten(model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
    """Return ``R^T v = R^-1 M v``, (nv,)."""
    momentum = np.empty_like(velocity)
    mujoco.mj_mulM(model, data, momentum, velocity)
    return whiten_gradients(model, data, momentum[None])[0]


def kinetic_norm(model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray) -> float:
    """Return ``|v| = sqrt(v^T M v)``."""
    momentum = np.empty_like(velocity)
    mujoco.mj_mulM(model, data, momentum, velocity)
    return sqrt(max(velocity.dot(momentum), 0.0))


def jump(model: mujoco.MjModel, data: mujoco.MjData, jacobian: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """Return ``M^-1 J^T Lambda``, (nv,)."""
    result = np.empty((1, model.nv))
    mujoco.mj_solveM(model, data, result, impulse.dot(jacobian)[None])
    return result[0]
