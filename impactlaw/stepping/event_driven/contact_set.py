"""Contacts that are near or closed, and the directions along which impulses on them act."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.friction import Friction
from impactlaw.scene.detection import Found
from impactlaw.scene.friction_rows import find_tangents
from impactlaw.stepping.collisions import Closed
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.location.travel import Frames


class Rows(NamedTuple):
    """Rows of the cone problem: contact by contact, the normal row first, then friction times its coefficients."""

    contact: np.ndarray  # index of the contact of each row, int (n,)
    kind: np.ndarray  # 0 for the normal, 1 to 5 for friction, int (n,)
    jacobian: np.ndarray  # ``J``, (n, nv)
    drift: np.ndarray  # velocities of moving surfaces, to be added to ``J v``, (n,)
    whitened: np.ndarray  # ``J R^-T``, (n, nv)

    @property
    def sizes(self) -> np.ndarray:
        """Number of rows of each contact that has rows, int."""
        sizes = np.bincount(self.contact, minlength=1)
        return sizes[sizes > 0]

    def velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Return the velocity of each row for a velocity of the scene, (nv,)."""
        return self.jacobian.dot(velocity) + self.drift

    def select(self, held: np.ndarray) -> Rows:
        """Return the rows of the given contacts, bool (h,)."""
        rows = np.flatnonzero(held[self.contact])
        return Rows(*(part[rows] for part in self))


class ContactSet:
    """Contacts that are near or closed, at one configuration.

    `tangents`, `rows`, `confined`, `yielding` and `lengths` are computed on first access, which must happen at
    that configuration; so must the first call of anything that uses them.

    Attributes:
        pattern: the properties of the contacts that follow from their geoms.
        contacts: the contacts.
        gap: their gaps, m, (h,).
        jacobian: gap gradients ``J``, (h, nv).
        configuration: the configuration of the contacts.
        frames: frames of all geoms.
        turns: rotations of `Configuration.body_axes`, (n, 3, 3).
        bilateral: gradients of equality constraints, which no impulse may violate, (m, nv); None if there are none.
        drift: contact velocities due to moving surfaces, m/s, (h,); None if there are none.
        drift_before: the same in the step before; None if it is the same.
    """

    drift: np.ndarray | None = None
    drift_before: np.ndarray | None = None

    def __init__(self, found: Found, configuration: Configuration):
        self.pattern, self.contacts, self.jacobian, self.bilateral, _ = found
        self.gap = self.contacts.gap
        self.configuration, data, surfaces = configuration, configuration.data, configuration.surfaces
        self.frames, self.turns = Frames.of(data), configuration.body_axes.turns(data)
        if surfaces is not None and surfaces.move and len(self.gap):
            self.drift = surfaces.drift(data, self.contacts)
            if surfaces.jumps(data):
                self.drift_before = surfaces.drift(data, self.contacts, before=True)

    def contact_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``gamma = J v + w``, m/s, (h,)."""
        gamma = self.jacobian.dot(velocity)
        return gamma if self.drift is None else gamma + self.drift

    def opening(self, shift: np.ndarray) -> float:
        """Return the largest change of a gap by a displacement, (nv,), m."""
        return float(np.abs(self.jacobian.dot(shift)).max(initial=0.0))

    def carried(self, rows: np.ndarray, start: ContactSet) -> np.ndarray:
        """Return rows found at another configuration, (k, nv), with the same directions in the world here."""
        axes = self.configuration.body_axes
        return axes.to_bodies(axes.to_world(rows, start.turns), self.turns)

    @cached_property
    def seen(self) -> np.ndarray:
        """The contact points, each seen from its two geoms, m, (h, 2, 3)."""
        geoms, (place, turn) = self.contacts.geoms, self.frames
        away = self.contacts.position[:, None] - place.take(geoms, 0)
        return (away[:, :, None] @ turn.take(geoms, 0).reshape(-1, 2, 3, 3))[:, :, 0]

    @cached_property
    def tangents(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Gradients of friction, (k, nv), and their velocities due to moving surfaces, (k,); None without friction."""
        if self.pattern.friction is None:
            return None
        self.configuration.refresh()
        model, data, surfaces = self.configuration.model, self.configuration.data, self.configuration.surfaces
        return find_tangents(model, data, self.contacts, self.pattern.friction, surfaces)

    @cached_property
    def rows(self) -> Rows:
        """The normal rows and the friction rows."""
        friction, tangents = self.pattern.friction, self.tangents
        drift = np.zeros(len(self.contacts)) if self.drift is None else self.drift
        if friction is None or tangents is None:
            contact = np.arange(len(self.contacts))
            return Rows(contact, np.zeros_like(contact), self.jacobian, drift, self.yielding)
        (sliding, more), mu, order = tangents, friction.coefficient, friction.rows_from
        J = np.concatenate([self.jacobian, mu[:, None] * sliding])[order]
        drift = np.concatenate([drift, mu * more])[order]
        return Rows(friction.rows_contact, friction.rows_kind, J, drift, self.whiten(J))

    def closed(self, which: np.ndarray) -> Closed:
        """Return the chosen contacts, ascending indices (k,), as contacts that may collide."""
        drift, before = (None if w is None else w[which] for w in (self.drift, self.drift_before))
        pattern, friction = self.pattern.friction, None
        if pattern is not None and self.tangents is not None:
            rows, sliding = self.tangents
            friction = Friction(rows, pattern.contact, pattern.coefficient, sliding).select(which)
        contacts, J = self.contacts, self.jacobian
        if len(which) < len(contacts):
            contacts, J = contacts.select(which), J[which]
        return Closed(contacts, J, self.bilateral, drift, before, friction)

    @cached_property
    def confined(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows ``J'`` along which equality constraints let bodies move apart, and ``Y = J' R^-T``, (h, nv) each.

        J' is J if there are no equality constraints.
        """
        J = self.jacobian
        if self.bilateral is None:
            return J, self.yielding
        Y = self.configuration.whiten_gradients(J)
        return self._constraints.confine(J, Y, self.bilateral), self._constraints.project(Y)

    @cached_property
    def yielding(self) -> np.ndarray:
        """``J R^-T``, (h, nv), with equality constraints that give way as MuJoCo's do."""
        return self.whiten(self.jacobian)

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Return whitened rows, (k, nv); a row that equality constraints fix completely becomes 0."""
        Y = self.configuration.whiten_gradients(rows)
        if self.bilateral is not None:
            Y[~self._constraints.project(Y).any(axis=1)] = 0.0
        return Y

    @cached_property
    def lengths(self) -> np.ndarray:
        """Lengths of the rows of Y, (h,)."""
        return np.sqrt(np.vecdot(self.confined[1], self.confined[1]))

    @cached_property
    def _constraints(self) -> Bilateral:
        assert self.bilateral is not None
        return Bilateral.of(self.configuration.whiten_gradients(self.bilateral))

    def along_constraints(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of a velocity, (nv,), that equality constraints fix; there must be some."""
        assert self.bilateral is not None
        part = self._constraints.basis.dot(self.configuration.whiten(velocity))
        return self.configuration.jump(self.bilateral, part.dot(self._constraints.combination))
