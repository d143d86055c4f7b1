"""Contacts with all that an impulse on them needs, and what an impulse does, by MuJoCo's sparse factor of the inertia.

MuJoCo factors ``M = L^T D L``, so that here ``R^T = D^1/2 L``: ``|R^T v|`` is the kinetic metric, and
``Y = J R^-T`` has ``Y Y^T = G`` (`impactlaw.metric`). All functions want current frames and inertia
(`impactlaw.contacts.update_positions`); those that use the factor want `Touch.whitened` before them.
"""

from __future__ import annotations

from math import sqrt

import mujoco
import numpy as np

from impactlaw.contacts import Contacts
from impactlaw.detection import Detector, Pattern
from impactlaw.flow import Frames


class Touch:
    """Contacts near each other or closed, at one configuration.

    Attributes:
        pattern: what their geoms say.
        contacts: the contacts.
        jacobian: gap gradients ``J``, (h, nv).
        frames: of all geoms.
    """

    def __init__(self, pattern: Pattern, contacts: Contacts, jacobian: np.ndarray, frames: Frames):
        self.pattern = pattern
        self.contacts = contacts
        self.jacobian = jacobian
        self.frames = frames
        self._whitened: tuple[np.ndarray, np.ndarray] | None = None

    def whitened(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return ``Y``, the gradients where the kinetic metric is Euclidean, (h, nv), and their lengths, (h,).

        Computed when first asked for, which must be before data leaves the configuration of this touch.
        """
        if self._whitened is None:
            mujoco.mj_factorM(model, data)
            Y = whiten_gradients(model, data, self.jacobian)
            self._whitened = Y, np.sqrt(np.vecdot(Y, Y))
        return self._whitened


def look(model: mujoco.MjModel, data: mujoco.MjData, detector: Detector, within: float) -> Touch:
    """Return the contacts and limits nearer than ``within``, m or rad, and perhaps more, at the current frames."""
    pattern, contacts, J = detector.look(data, within)
    return Touch(pattern, contacts, J, Frames.of(data))


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
