"""Leave contacts with fixed bodies out that a body passes over, although their gradients say that they close.

A body that slides or rolls over a floor of several pieces, as the prisms of a height field, comes near the edge of the
piece ahead. That gap closes along its gradient, but the body passes over the edge. Where a body has a nearer contact
with fixed bodies in another direction, such contacts are therefore left out at first. If the resulting velocity v+
closes them, the gap is measured where it leads, at ``q_M ⊕ h v+``, where the next step looks for contacts, and halfway
there, at the end of this step. Only contacts of bodies that overlap there take part.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.tolerances import APART, TOUCHING
from impactlaw.solvers.cones.algebra.loops import cleared, integers, kernel, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.dense import sparse_jacobian
from impactlaw.stepping.compiled.left_out.hidden_edges import moving_side

_PLANE, _SDF = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SDF)
_SAME = 1.0 - 1e-6
"""Cosine of the angle between two normals from which they are one direction."""
_PASSED = 3e-6
"""Overlap, m, up to which a body passes over an edge."""


@plain
def _can_pass(pair, own, geometry):
    """Return whether a geom can pass over a fixed one; other data do not know where mocap bodies carry them."""
    shape, body_of_geom, _, _, root, mocap = geometry
    kind = shape[pair[1 - own]]
    for i in range(2):
        if mocap[root[body_of_geom[pair[i]]]] >= 0:
            return False
    return kind != _PLANE and kind != _SDF


@kernel
def leave_doubtful(contacts, geometry, chosen, doubtful):
    """Leave contacts out that bodies may pass over; return whether there are any.

    These are open contacts of a body with a fixed one, if it has a nearer one in another direction. Of two that are
    equally near, as of a ball that falls into the middle of a groove, both take part.

    Args:
        contacts: gaps, m, (ncon,), frames with normals first, at least (ncon, 3), geoms, (ncon, 2), and first rows,
            (ncon,).
        geometry: MuJoCo's geom_type, geom_bodyid, body_weldid, body_treeid, body_rootid and body_mocapid.
        chosen: MuJoCo's rows that take part, bool (nefc,); written.
        doubtful: the contacts that are left out, bool (ncon,), False; written.
    """
    (dist, frame, geom, address), (_, body_of_geom, weld, tree, _, _), some = contacts, geometry, False
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0 and address[k] >= 0 and chosen[address[k]]:
            doubtful[k] = dist[k] > TOUCHING and _can_pass(geom[k], own, geometry)
            some = some or doubtful[k]
    if not some:
        return False
    nearest, some = integers(len(weld)), False
    nearest[:] = -1
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0 and address[k] >= 0 and chosen[address[k]]:
            body = weld[body_of_geom[geom[k, own]]]
            if nearest[body] < 0 or dist[k] < dist[nearest[body]]:
                nearest[body] = k
    for k in range(len(dist)):
        if not doubtful[k]:
            continue
        own, along = moving_side(geom[k], body_of_geom, tree), 0.0
        s = nearest[weld[body_of_geom[geom[k, own]]]]
        for i in range(3):
            along += frame[k, i] * frame[s, i]
        if own != moving_side(geom[s], body_of_geom, tree):
            along = -along
        doubtful[k] = along < _SAME and dist[k] > dist[s] + TOUCHING
        if doubtful[k]:
            chosen[address[k]], some = False, True
    return some


@plain
def _thickness(g, extent):
    """Return the smallest half size of the box around a geom, m."""
    return min(extent[g, 3], extent[g, 4], extent[g, 5])


@plain
def _is_asked(k, address, doubtful, chosen, seen):
    """Return whether it is asked if a contact closes."""
    return doubtful[k] and seen[address[k]] and not chosen[address[k]]


@plain
def _way(row, jacobian, velocity, timestep):
    """Return how far a contact opens in a timestep along its gradient, m."""
    (nnz, adr, col, J), along = jacobian, 0.0
    for a in range(adr[row], adr[row] + nnz[row]):
        along += J[a] * velocity[col[a]]
    return timestep * along


@plain
def _place(middle, qpos, velocity, time, at):
    """Move other data to where a velocity leads within some time."""
    put(qpos, middle)
    mj.integrate_pos(at[0], at[2], at[3], time)
    mj.kinematics(at[0], at[1])


@kernel
def pass_over(contacts, geometry, extent, jacobian, velocity, timestep, middle, qpos, at, chosen, seen, doubtful):
    """Take contacts out of those that a velocity closes if bodies pass over them.

    A body that would get deeper than it is thick counts as one that does not pass.

    Args:
        contacts: see `leave_doubtful`, like the next one.
        geometry: properties of geoms and bodies.
        extent: MuJoCo's geom_aabb, (ngeom, 6).
        jacobian: see `rows.Source`.
        velocity: v+, (nv,).
        timestep: h, s.
        middle: q_M, (nq,).
        qpos: position of other data, (nq,), written.
        at: addresses of the model, of these data, of ``qpos`` and of ``velocity``.
        chosen: MuJoCo's rows that take part already, bool (nefc,).
        seen: rows that the velocity closes, bool (nefc,); written.
        doubtful: see `leave_doubtful`.
    """
    (dist, _, geom, address), (_, body_of_geom, _, tree, _, _) = contacts, geometry
    hit, share, many = cleared(len(dist)), 1.0, 0
    for k in range(len(dist)):
        if _is_asked(k, address, doubtful, chosen, seen):
            own = geom[k, moving_side(geom[k], body_of_geom, tree)]
            hit[k] = -dist[k] - _way(address[k], jacobian, velocity, timestep) > _thickness(own, extent)
            many += not hit[k]
    while many > 0 and share >= 0.5:
        _place(middle, qpos, velocity, share * timestep, at)
        many = _hits(geom, address, at, chosen, seen, doubtful, hit)
        share *= 0.5
    for k in range(len(dist)):
        if _is_asked(k, address, doubtful, chosen, seen) and not hit[k]:
            seen[address[k]] = False


@plain
def _hits(geom, address, at, chosen, seen, doubtful, hit):
    """Mark contacts whose bodies overlap in other data; return how many are not marked."""
    many, end, gap = 0, 0, 0.0
    while end < len(geom):
        first, asked = end, False
        while end < len(geom) and geom[end, 0] == geom[first, 0] and geom[end, 1] == geom[first, 1]:
            asked = asked or (not hit[end] and _is_asked(end, address, doubtful, chosen, seen))
            end += 1
        if asked:
            gap = mj.geom_distance(at[0], at[1], geom[first, 0], geom[first, 1], APART, 0)
        for k in range(first, end if asked else first):
            if _is_asked(k, address, doubtful, chosen, seen):
                hit[k] = hit[k] or gap < -_PASSED
                many += not hit[k]
    return many


_leave_doubtful, _pass_over = map(for_python, (leave_doubtful, pass_over))


class PassedEdges:
    """Finds contacts that bodies pass over, in steps that are taken in Python."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._other: mujoco.MjData | None = None

    def leave_doubtful(self, data: mujoco.MjData, near: np.ndarray) -> np.ndarray:
        """Return which contacts bodies may pass over, bool (ncon,); their rows are taken out of those that are near."""
        doubtful = np.zeros(data.ncon, dtype=bool)
        _leave_doubtful(_contacts(data), self._geometry(), near, doubtful)
        return doubtful

    def pass_over(
        self, data: mujoco.MjData, middle: np.ndarray, near: np.ndarray, seen: np.ndarray, doubtful: np.ndarray
    ) -> None:
        """Take the rows of contacts that bodies pass over out of those that the velocity of data closes.

        Args:
            data: the state with current contacts.
            middle: q_M, (nq,).
            near: MuJoCo's rows that take part already, bool (nefc,).
            seen: those that the velocity closes, bool (nefc,); written.
            doubtful: see `leave_doubtful`.
        """
        model = self._model
        if self._other is None:
            self._other = mujoco.MjData(model)
        velocity = data.qvel.copy()
        places = model._address, self._other._address, self._other.qpos.ctypes.data, velocity.ctypes.data
        _pass_over(
            _contacts(data), self._geometry(), model.geom_aabb, sparse_jacobian(model, data), velocity,
            model.opt.timestep, middle, self._other.qpos, places, near, seen, doubtful,
        )  # fmt: skip

    def _geometry(self) -> tuple[np.ndarray, ...]:
        m = self._model
        return m.geom_type, m.geom_bodyid, m.body_weldid, m.body_treeid, m.body_rootid, m.body_mocapid


def _contacts(data: mujoco.MjData) -> tuple[np.ndarray, ...]:
    found = data.contact
    return found.dist, found.frame, found.geom, found.efc_address
