"""Contacts with all that an impulse on them needs, and what an impulse does, by MuJoCo's sparse factor of the inertia.

MuJoCo factors ``M = L^T D L``, so that here ``R^T = D^1/2 L``: ``|R^T v|`` is the kinetic metric, and
``Y = J R^-T`` has ``Y Y^T = G`` (`impactlaw.mechanics.kinetic_metric`). All functions want current frames and inertia
(`impactlaw.scene.contacts.update_positions`); those that use the factor want `ContactSet.whitened` before them.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.friction import Friction
from impactlaw.scene.detection import Found
from impactlaw.scene.friction_rows import Tangents, find_tangents
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.collisions import Closed
from impactlaw.stepping.event_driven.travel import Frames


class Rows(NamedTuple):
    """Rows of contacts, contact by contact: pressing first, then friction times its coefficients.

    Attributes:
        contact: index of the contact of each row, int (n,).
        kind: 0 for pressing, 1 to 5 for friction, int (n,).
        jacobian: ``J``, (n, nv).
        drift: what moving surfaces add to the velocities ``J v``, (n,).
        along: ``J'``, along which impulses act, (n, nv).
        whitened: ``J' R^-T``, (n, nv).
    """

    contact: np.ndarray
    kind: np.ndarray
    jacobian: np.ndarray
    drift: np.ndarray
    along: np.ndarray
    whitened: np.ndarray


class ContactSet:
    """Contacts near each other or closed, at one configuration.

    Attributes:
        pattern: what their geoms say.
        contacts: the contacts.
        jacobian: gap gradients ``J``, (h, nv).
        frames: of all geoms.
        bilateral: gradients of equality constraints, which no impulse may violate, (m, nv); None if there are none.
        drift: what surfaces that move add to contact velocities, m/s, (h,); None if there are none.
        drift_before: the same in the step before; None if it is no other.
    """

    drift: np.ndarray | None = None
    drift_before: np.ndarray | None = None
    _tangents: Tangents | None = None
    _rows: Rows | None = None
    _span: Bilateral | None = None
    _whitened: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def __init__(self, found: Found, data: mujoco.MjData, surfaces: Surfaces | None):
        self.pattern, self.contacts, self.jacobian, self.bilateral = found
        self.frames = Frames.of(data)
        if surfaces is not None and surfaces.move and self.pattern:
            self.drift = surfaces.drift(data, self.contacts)
            if surfaces.jumps(data):
                self.drift_before = surfaces.drift(data, self.contacts, before=True)
        self._surfaces = surfaces

    def contact_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``gamma = J v + w``, m/s, (h,)."""
        gamma = self.jacobian.dot(velocity)
        return gamma if self.drift is None else gamma + self.drift

    def opening(self, shift: np.ndarray) -> float:
        """Return the largest change of a gap by a displacement, (nv,), m."""
        return float(np.abs(self.jacobian.dot(shift)).max(initial=0.0))

    def tangents(self, model: mujoco.MjModel, data: mujoco.MjData) -> Tangents | None:
        """Return the rows of friction; None if there are none.

        Computed when first asked for, which must be before data leaves the configuration of this touch.
        """
        if self._tangents is None and self.pattern.friction_pattern is not None:
            self._tangents = find_tangents(model, data, self.contacts, self.pattern.friction_pattern, self._surfaces)
        return self._tangents

    def rows(self, model: mujoco.MjModel, data: mujoco.MjData) -> Rows:
        """Return the rows of pressing and of friction; see `tangents` for when to ask first."""
        if self._rows is None:
            contact, kind, order = self.pattern.rows
            J, drift = self.jacobian, np.zeros(len(self.contacts)) if self.drift is None else self.drift
            tangents = self.tangents(model, data)
            if tangents is not None:
                friction_pattern, sliding, more = tangents
                mu = friction_pattern.coefficient
                J = np.concatenate([J, mu[:, None] * sliding])[order]
                drift = np.concatenate([drift, mu * more])[order]
            self.whitened(model, data)
            self._rows = Rows(contact, kind, J, drift, *self.confine(model, data, J))
        return self._rows

    def closed(self, model: mujoco.MjModel, data: mujoco.MjData, which: np.ndarray) -> Closed:
        """Return some of the contacts, (k,) indices, as ones that may collide; frames must be those of this touch."""
        drift, before = (None if w is None else w[which] for w in (self.drift, self.drift_before))
        tangents, friction = self.tangents(model, data), None
        if tangents is not None:
            friction_pattern, J, sliding = tangents
            friction = Friction(J, friction_pattern.contact, friction_pattern.coefficient, sliding).select(which)
        return Closed(self.contacts.select(which), self.jacobian[which], self.bilateral, drift, before, friction)

    def whitened(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what impulses do: the rows ``J'`` along which they act, ``Y = J' R^-T`` and the lengths of Y's rows.

        ``J' = J`` where there are no equality constraints. Shapes (h, nv), (h, nv) and (h,). Computed when first asked
        for, which must be before data leaves the configuration of this touch.
        """
        if self._whitened is None:
            mujoco.mj_factorM(model, data)
            if self.bilateral is not None:
                self._span = Bilateral.of(whiten_gradients(model, data, self.bilateral))
            J, Y = self.confine(model, data, self.jacobian)
            self._whitened = J, Y, np.sqrt(np.vecdot(Y, Y))
        return self._whitened

    def confine(self, model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return other rows without what equality constraints fix, and the same whitened, (k, nv); see `whitened`."""
        Y = whiten_gradients(model, data, rows)
        if self._span is None or self.bilateral is None:
            return rows, Y
        return self._span.confine(rows, Y, self.bilateral), self._span.project(Y)

    def along_constraints(self, model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
        """Return the part of a velocity, (nv,), that equality constraints fix; `whitened` must have been asked for."""
        if self._span is None or self.bilateral is None:
            return np.zeros_like(velocity)
        part = self._span.basis.dot(whiten(model, data, velocity))
        return jump(model, data, self.bilateral, part.dot(self._span.combination))


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
