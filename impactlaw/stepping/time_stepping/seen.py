"""The groups of rows of a step as contacts and as a collision, for laws, events and whoever reads them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.collision import Collision
from impactlaw.contacts import Contacts
from impactlaw.friction import Friction
from impactlaw.limits import NO_GEOM, Limits
from impactlaw.stepping.time_stepping.dense import gradients, sparse_jacobian
from impactlaw.stepping.time_stepping.rows import BILATERAL, Rows

_ROUNDING = 1e-12


def in_order(rows: Rows, chosen: np.ndarray) -> np.ndarray:
    """Return the groups of a mask, bool (g,), contacts by their geoms and then limits, int (k,)."""
    groups = np.flatnonzero(chosen)
    return groups[np.lexsort((rows.key[groups], rows.source[groups] < 0))]


def seen_contacts(
    model: mujoco.MjModel, data: mujoco.MjData, rows: Rows, groups: np.ndarray, names: tuple[str, ...], limits: Limits
) -> Contacts:
    """Return some groups, int (k,), as contacts; limits last.

    Args:
        model: the scene.
        data: its constraint rows of now.
        rows: the rows of the step.
        groups: contacts, and after them limits.
        names: of all geoms, as in contact labels.
        limits: of joints and tendons.
    """
    found, source = data.contact, rows.source[groups]
    index = source[source >= 0]
    geoms, normal = found.geom[index].astype(int), found.frame[index, :3].copy()
    swapped = geoms[:, 0] > geoms[:, 1]
    geoms[swapped], normal[swapped] = geoms[swapped, ::-1], -normal[swapped]
    labels = [f"{names[a]}/{names[b]}" for a, b in geoms]
    position = found.pos[index]
    reached = -2 - source[source < -1]
    if len(reached):
        code = np.array([limits.code(data, int(row)) for row in reached])
        places, axes = limits.places(data, code)
        labels += [limits.labels[i] for i in code]
        geoms = np.vstack([geoms, np.full((len(code), 2), NO_GEOM)])
        position, normal = np.vstack([position, places]), np.vstack([normal, axes])
    return Contacts(tuple(labels), geoms, rows.gap[groups], position, normal)


@dataclass(frozen=True, eq=False)
class SeenRows:
    """Gradients and velocities of some groups as full arrays.

    Attributes:
        jacobian: gap gradients, (h, nv).
        velocity: ``gamma-``, that of moving surfaces included, (h,).
        tangents: gradients of rows of friction, (k, nv).
        sliding: velocities of these rows, (k,).
        contact: the contact of each, int (k,).
        coefficient: of each, (k,).
        tangential: which rows of the step they are, int (k,).
        bilateral: gradients of equality constraints, (m, nv).
    """

    jacobian: np.ndarray
    velocity: np.ndarray
    tangents: np.ndarray
    sliding: np.ndarray
    contact: np.ndarray
    coefficient: np.ndarray
    tangential: np.ndarray
    bilateral: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, rows: Rows, groups: np.ndarray) -> SeenRows:
        """Return those of some groups, int (h,)."""
        sparse = sparse_jacobian(model, data)
        first, more = rows.first[groups], rows.size[groups] - 1
        contact = np.repeat(np.arange(len(groups)), more)
        tangential = first[contact] + 1 + np.arange(len(contact)) - np.repeat(np.cumsum(more) - more, more)
        equal = rows.first[rows.kind == BILATERAL]
        return cls(
            gradients(rows.row[first], *sparse, model.nv),
            rows.before[first],
            gradients(rows.row[tangential], *sparse, model.nv),
            rows.before[tangential],
            contact,
            rows.scale[tangential],
            tangential,
            gradients(rows.row[equal], *sparse, model.nv),
        )

    def collision(self, mass_matrix: np.ndarray, velocity: np.ndarray, labels: tuple[str, ...]) -> Collision:
        """Return the collision at v-, (nv,)."""
        surface = _beside(self.velocity, self.jacobian @ velocity)
        friction = None
        if len(self.contact):
            along = _beside(self.sliding, self.tangents @ velocity)
            friction = Friction(self.tangents, self.contact, self.coefficient, along)
        return Collision(
            mass_matrix,
            self.jacobian,
            velocity,
            labels=labels,
            friction=friction,
            surface_velocity=surface if surface.any() else None,
            bilateral_jacobian=self.bilateral if len(self.bilateral) else None,
        )


def _beside(velocity: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return what moving surfaces add to velocities of rows, 0 where it is rounding."""
    drift = velocity - own
    drift[np.abs(drift) <= _ROUNDING * np.abs(velocity).max(initial=0.0)] = 0.0
    return drift
