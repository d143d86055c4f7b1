"""Collisions that draw energy out of constraints that give way, or out of surfaces between which bodies jam."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import Contacts, acted_on
from impactlaw.scene.equality_constraints import CALM, RESTING, constraint_kinds, least_free, lengths
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.soft.tolerances import DRAGGED, GAINED

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


class Constraints:
    """The equality constraints of a step: which rows keep their velocity in collisions, which islands they drive.

    Args:
        model: the scene.
        data: the state, with current rows.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        # numba is not loaded before it is used
        from impactlaw.compiled import for_python
        from impactlaw.stepping.compiled.dense import sparse_jacobian
        from impactlaw.stepping.compiled.islands import find_islands
        from impactlaw.stepping.compiled.left_out.tied_contacts import find_tied

        jacobian, trees = sparse_jacobian(model, data), model.dof_treeid
        island, of_row = find_islands(data.efc_type, data.efc_id, *jacobian, trees, model.ntree)
        self._island, self._of_row = island[trees], of_row[: data.ne]
        self._driven = np.zeros(model.ntree, dtype=bool)
        address, kinds = np.ascontiguousarray(data.contact.efc_address), constraint_kinds(model)
        paired = (data.contact.dim > 1) & (model.opt.cone == _PYRAMIDAL)
        tied = np.zeros(len(address), dtype=bool)
        least = least_free(model, data.contact.geom)
        rows = data.efc_type, data.efc_id, kinds, jacobian
        for_python(find_tied)(*rows, lengths(model), address, paired, least, tied)
        self._tied = tied[acted_on(model, data)]

    def tie(self, contacts: Contacts) -> np.ndarray:
        """Return which contacts constraints tie, bool (h,), see `left_out.tied_contacts`; limits are never tied."""
        tied = np.zeros(len(contacts), dtype=bool)
        tied[contacts.geoms[:, 0] >= 0] = self._tied
        return tied

    def calm(self, jacobian: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """Return the speed up to which each constraint row keeps its velocity in a collision, m/s or rad/s, (ne,).

        It is a part of the largest closing speed in the island of the row; faster rows are giving way.

        Args:
            jacobian: gap gradients of the contacts, (h, nv).
            gamma: contact velocities, (h,).
        """
        fastest = np.zeros(len(self._driven) + 1)  # the last entry is for rows that move no body
        moves = jacobian.any(axis=1)
        where = self._island[(jacobian[moves] != 0.0).argmax(axis=1)]
        np.maximum.at(fastest, where, -gamma[moves])
        return (np.append(np.where(self._driven, RESTING, CALM), 0.0) * fastest)[self._of_row]

    def drive(self, events: list[ImpactEvent]) -> np.ndarray:
        """Return in which islands constraints that give way have driven bodies into each other, bool (ntree,).

        There collisions gain more than a part `GAINED` of the energy of their velocity jump. Islands that were found
        before are left out.
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
        """From now on, leave constraints of these islands, bool (ntree,), out of collisions if they move at all."""
        self._driven |= islands


def is_dragged(impact: Impact, mass: float) -> bool:
    """Return whether surfaces that move against each other have thrown bodies that jam between them.

    In the frame of a single moving surface a collision creates no energy. A mass m that follows the surface with
    velocity w is therefore at most as fast as ``|v+| <= |v-| + 2 w sqrt(m)`` in the kinetic metric. A jam between two
    surfaces, such as a belt and a deck at rest, can supply any energy.

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
