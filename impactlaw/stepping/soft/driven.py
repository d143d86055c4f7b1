"""Collisions that draw their energy out of what gives way, or out of surfaces between which bodies jam."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import Contacts, acted_on
from impactlaw.scene.equality_constraints import CALM, RESTING, constraint_kinds, lengths
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.soft.tolerances import DRAGGED, GAINED

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


class Constraints:
    """Equality constraints next to the collisions of their own islands, and which islands these constraints drive.

    Args:
        model: the scene.
        data: rows current.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        # numba is not loaded before it is used
        from impactlaw.stepping.compiled.dense import sparse_jacobian
        from impactlaw.stepping.compiled.islands import joined_trees, trees_of_rows
        from impactlaw.stepping.compiled.ties import tied_contacts

        jacobian, trees = sparse_jacobian(model, data), model.dof_treeid
        island = joined_trees(data.efc_type, data.efc_id, *jacobian, trees, model.ntree)
        self._island, self._of_row = island[trees], trees_of_rows(*jacobian, trees, data.ne)
        self._of_row[self._of_row >= 0] = island[self._of_row[self._of_row >= 0]]
        self._driven = np.zeros(model.ntree, dtype=bool)
        address, kinds = np.ascontiguousarray(data.contact.efc_address), constraint_kinds(model)
        paired = (data.contact.dim > 1) & (model.opt.cone == _PYRAMIDAL)
        tied = tied_contacts(data.efc_type, data.efc_id, kinds, *jacobian, lengths(model), address, paired)
        self._tied = tied[acted_on(data)]

    def tie(self, contacts: Contacts) -> np.ndarray:
        """Return which contacts are tied, bool (h,), see `stepping.compiled.ties`; no limits are."""
        tied = np.zeros(len(contacts), dtype=bool)
        tied[contacts.geoms[:, 0] >= 0] = self._tied
        return tied

    def calm(self, jacobian: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """Return how fast rows may move against themselves and keep that in a collision, m/s or rad/s, (ne,).

        Args:
            jacobian: of contacts, (h, nv).
            gamma: their velocities, (h,).
        """
        fastest = np.zeros(len(self._driven) + 1)  # the last one is for rows that move nothing
        moves = jacobian.any(axis=1)
        where = self._island[(jacobian[moves] != 0.0).argmax(axis=1)]
        np.maximum.at(fastest, where, -gamma[moves])
        return (np.append(np.where(self._driven, RESTING, CALM), 0.0) * fastest)[self._of_row]

    def drive(self, events: list[ImpactEvent]) -> np.ndarray:
        """Return in which islands constraints that give way have driven bodies into each other, bool (ntree,).

        There a part of the energy is theirs. Islands that have been found before are left out.
        """
        found = np.zeros(len(self._driven), dtype=bool)
        for event in events:
            collision = event.impact.collision
            if collision.bilateral_jacobian is None:
                continue
            z = collision.metric.whiten(event.impact.post_velocity - collision.pre_velocity)
            v, many = collision.metric.whiten(collision.pre_velocity), len(found)
            gained = np.bincount(self._island, z * (v + 0.5 * z), minlength=many)
            found |= gained > 0.5 * GAINED * np.bincount(self._island, z * z, minlength=many)
        return found & ~self._driven

    def give_way(self, islands: np.ndarray) -> None:
        """Let constraints of islands, bool (ntree,), that move at all not take part in collisions."""
        self._driven |= islands


def is_dragged(impact: Impact, mass: float) -> bool:
    """Return whether surfaces that move against each other have thrown what jams between them.

    In the frame of one moving surface a collision creates no energy, so that it makes a mass m, which follows it with
    w, no faster than ``|v+| <= |v-| + 2 w sqrt(m)``. Out of a jam between two, as between a belt and a deck that
    rests, any energy can come.

    Args:
        impact: the collision.
        mass: of all bodies that move, kg.
    """
    collision, friction = impact.collision, impact.collision.friction
    rows = [(collision.jacobian, collision.surface_velocity, collision.post_surface_velocity)]
    if friction is not None:
        rows.append((friction.jacobian, friction.surface_velocity, friction.post_surface_velocity))
    fastest = turned = 0.0
    for jacobian, before, after in rows:
        if before is None:
            continue
        w = np.maximum(np.abs(before), np.abs(before if after is None else after))
        whitened = collision.metric.whiten_gradients(np.asarray(jacobian)[w > 0.0])
        square = np.vecdot(whitened, whitened)
        fastest = max(fastest, w.max(initial=0.0))
        turned += float((w[w > 0.0][square > 0.0] ** 2 / square[square > 0.0]).sum())
    if not fastest:
        return False
    followed = max(fastest * math.sqrt(mass), math.sqrt(turned))
    after = math.sqrt(max(0.0, collision.pre_speed**2 + 2.0 * impact.energy_change))
    return after > DRAGGED * (collision.pre_speed + 2.0 * followed)
