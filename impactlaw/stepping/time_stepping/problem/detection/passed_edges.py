"""Leave contacts out that a body passes, although their gradients say that they close.

A body that slides or rolls over a floor of several pieces, as the prisms of a height field, comes near the edge of the
piece ahead. That gap closes along its gradient, but the body passes over the edge. So does a gap to an edge, or to
another ball, that a fast ball flies past. Open contacts are therefore left out at first

- of a body with a fixed one, where it has a nearer contact with fixed bodies in another direction;
- of bodies that move along each other by more than a quarter of their half thickness in a timestep, or by more than a
  hundredth of their gap if both have edges.

If the resulting velocity v+ closes them, the gap is measured where it leads, at ``q_M ⊕ h v+``, where the next step
looks for contacts, and on the way there. Only contacts of bodies that overlap there take part. Fast bodies that do so
with the velocity without contact take part from the beginning.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.tolerances import APART, TOUCHING
from impactlaw.solvers.cones.algebra.loops import cleared, integers, kernel, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.dense import sparse_jacobian
from impactlaw.stepping.compiled.left_out.hidden_edges import moving_side
from impactlaw.stepping.time_stepping.problem.detection.carriers import carried_at, carry_on

_PLANE, _CYLINDER, _BOX, _MESH, _SDF = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "BOX", "MESH", "SDF")
)
_SAME = 1.0 - 1e-6
"""Cosine of the angle between two normals from which they are one direction."""
_PASSED = 3e-6
"""Overlap, m, up to which a body passes over an edge."""
_FAST = 0.25
"""Way of bodies along each other in a timestep, relative to half the thickness of the thinner one, that is long ..."""
_BESIDE = 1e-2
"""... or relative to their gap, if both have edges: as these come nearer, the gradient of the gap turns at once."""
_SIDE = 1e-3
"""Cosine of the angle between a normal and the axis of a cylinder up to which its side is met."""
_NEARLY = 1e-5
"""Gap, m, up to which bodies nearly touch: they may slide on each other."""
_LOOKS = 8
"""Largest number of places where a gap is measured."""


@plain
def _can_pass(pair, shape):
    """Return whether a geom can pass another one."""
    can = True
    for i in range(2):
        can = can and shape[pair[i]] != _PLANE and shape[pair[i]] != _SDF
    return can


@plain
def _has_edge(g, frame, shape, turned):
    """Return whether a contact can be at an edge of a geom: at a box or a mesh, and off the side of a cylinder."""
    if shape[g] == _CYLINDER:
        return abs(turned[g, 2] * frame[0] + turned[g, 5] * frame[1] + turned[g, 8] * frame[2]) > _SIDE
    return shape[g] == _BOX or shape[g] == _MESH


@plain
def _thickness(g, extent):
    """Return half the smallest size of the box around a geom, m."""
    return min(extent[g, 3], extent[g, 4], extent[g, 5])


@plain
def _carried(axis, g, point, geometry, carriers):
    """Return a component of the velocity at which a mocap body carries a point of a geom, m/s."""
    _, body_of_geom, _, _, root, mocap = geometry
    return carried_at(axis, mocap[root[body_of_geom[g]]], point, carriers)


@plain
def _velocity(axis, g, point, geometry, motion, carriers):
    """Return a component of the velocity of a point of a geom, m/s."""
    (_, body_of_geom, _, _, root, _), (velocity, center, _, _, _) = geometry, motion
    b = body_of_geom[g]
    i, j, c = (axis + 1) % 3, (axis + 2) % 3, root[b]
    turning = velocity[b, i] * (point[j] - center[c, j]) - velocity[b, j] * (point[i] - center[c, i])
    return velocity[b, 3 + axis] + turning + _carried(axis, g, point, geometry, carriers)


@plain
def _is_fast(pair, gap, point, frame, geometry, motion, carriers):
    """Return whether two geoms move along each other by a long way in a timestep, see `_FAST` and `_BESIDE`."""
    (_, _, extent, timestep, turned), shape, square, along = motion, geometry[0], 0.0, 0.0
    for axis in range(3):
        v = _velocity(axis, pair[1], point, geometry, motion, carriers)
        v -= _velocity(axis, pair[0], point, geometry, motion, carriers)
        square += v * v
        along += v * frame[axis]
    way = _FAST * min(_thickness(pair[0], extent), _thickness(pair[1], extent))
    edges = _has_edge(pair[0], frame, shape, turned) and _has_edge(pair[1], frame, shape, turned)
    if edges and gap > _NEARLY:
        way = min(way, _BESIDE * gap)
    return timestep * timestep * (square - along * along) > way * way


@kernel
def leave_fast(contacts, geometry, motion, carriers, chosen, doubtful):
    """Leave contacts out of bodies that move fast along each other and may miss; return whether there are any.

    Args:
        contacts: gaps, m, (ncon,), points, (ncon, 3), frames with normals first, at least (ncon, 3), geoms, (ncon, 2),
            and first rows, (ncon,).
        geometry: MuJoCo's geom_type, geom_bodyid, body_weldid, body_treeid, body_rootid and body_mocapid.
        motion: MuJoCo's cvel, subtree_com and geom_aabb, h, s, and geom_xmat.
        carriers: mocap bodies, see `carriers.carried_at`.
        chosen: MuJoCo's rows that take part, bool (nefc,); written.
        doubtful: the contacts that are left out, bool (ncon,), False; written.
    """
    some, (gap, point, frame, geom, address) = False, contacts
    for k in range(len(gap)):
        takes_part = gap[k] > TOUCHING and address[k] >= 0 and chosen[address[k]] and _can_pass(geom[k], geometry[0])
        if takes_part and _is_fast(geom[k], gap[k], point[k], frame[k], geometry, motion, carriers):
            doubtful[k], chosen[address[k]], some = True, False, True
    return some


@kernel
def take_back(contacts, chosen, seen, doubtful):
    """Let contacts that the velocity without contact closes, see `pass_over`, take part from the beginning."""
    address = contacts[4]
    for k in range(len(address)):
        if doubtful[k] and seen[address[k]]:
            doubtful[k], chosen[address[k]] = False, True


@kernel
def leave_edges(contacts, geometry, chosen, doubtful):
    """Leave contacts with edges of fixed bodies out that bodies may pass over; return whether there are any.

    These are open contacts of a body with a fixed one, if it has a nearer one in another direction. Of two that are
    equally near, as of a ball that falls into the middle of a groove, both take part. For the arguments see
    `leave_fast`.
    """
    (dist, _, frame, geom, address), (shape, body_of_geom, weld, tree, _, _), some = contacts, geometry, False
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0 and address[k] >= 0 and chosen[address[k]]:
            doubtful[k] = dist[k] > TOUCHING and _can_pass(geom[k], shape)
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
        if not doubtful[k] or not chosen[address[k]]:
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
def _is_asked(k, address, doubtful, chosen, seen):
    """Return whether it is asked if a contact closes."""
    return doubtful[k] and seen[address[k]] and not chosen[address[k]]


@plain
def _rate(k, contacts, geometry, carriers, jacobian, velocity):
    """Return how fast a contact opens along its gradient, m/s."""
    (_, point, frame, geom, address), (nnz, adr, col, J), along = contacts, jacobian, 0.0
    for a in range(adr[address[k]], adr[address[k]] + nnz[address[k]]):
        along += J[a] * velocity[col[a]]
    for axis in range(3):
        for i in range(2):
            along += (2 * i - 1) * frame[k, axis] * _carried(axis, geom[k, i], point[k], geometry, carriers)
    return along


@plain
def _place(middle, carriers, place, time, at):
    """Move other data to where velocities lead within some time."""
    qpos, position, quaternion = place
    put(qpos, middle)
    carry_on(carriers, time, position, quaternion)
    mj.integrate_pos(at[0], at[2], at[3], time)
    mj.kinematics(at[0], at[1])


@kernel
def pass_over(
    contacts, geometry, extent, carriers, jacobian, velocity, timestep, middle, place, at, chosen, seen, doubtful
):  # fmt: skip
    """Take contacts out of those that a velocity closes if bodies pass them.

    Gaps are measured at least once while the body, or two that move, enter by half their thickness. Bodies that would
    enter by more than `_LOOKS` allow count as bodies that do not pass.

    Args:
        contacts: see `leave_fast`, like the next one.
        geometry: properties of geoms and bodies.
        extent: MuJoCo's geom_aabb, (ngeom, 6).
        carriers: see `leave_fast`.
        jacobian: see `rows.Source`.
        velocity: v+, (nv,).
        timestep: h, s.
        middle: q_M, (nq,).
        place: qpos, mocap_pos and mocap_quat of other data, written.
        at: addresses of the model, of these data, of their qpos and of ``velocity``.
        chosen: MuJoCo's rows that take part already, bool (nefc,).
        seen: rows that the velocity closes, bool (nefc,); written.
        doubtful: see `leave_fast`.
    """
    (dist, _, _, geom, address), (_, body_of_geom, _, tree, _, _) = contacts, geometry
    hit, looks, many = cleared(len(dist)), 2, 0
    for k in range(len(dist)):
        if _is_asked(k, address, doubtful, chosen, seen):
            own, thin = moving_side(geom[k], body_of_geom, tree), 0.0
            for i in range(2):
                if own < 0 or i == own:
                    thin += _thickness(geom[k, i], extent)
            way = timestep * _rate(k, contacts, geometry, carriers, jacobian, velocity)
            parts = np.ceil((-dist[k] - way) / thin)
            hit[k] = 2.0 * parts > _LOOKS
            if not hit[k]:
                many, looks = many + 1, max(looks, 2 * int(parts))
    for i in range(looks, 0, -1):
        if many > 0:
            _place(middle, carriers, place, i / looks * timestep, at)
            many = _hits(geom, address, at, chosen, seen, doubtful, hit)
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


_leave_fast, _leave_edges, _pass_over, _take_back = map(for_python, (leave_fast, leave_edges, pass_over, take_back))


class PassedEdges:
    """Finds contacts that bodies pass, in steps that are taken in Python.

    Args:
        model: the scene.
        surfaces: surfaces that move during the step; None if there are none.
    """

    def __init__(self, model: mujoco.MjModel, surfaces: Surfaces | None):
        self._model, self._surfaces = model, surfaces
        self._other: mujoco.MjData | None = None

    def leave_fast(self, data: mujoco.MjData, start: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return the result of `leave_fast`, bool (ncon,), for the velocity at the start of the step, (nv,).

        The rows of these contacts are taken out of those that are near.
        """
        doubtful, model, free = np.zeros(data.ncon, dtype=bool), self._model, data.qvel.copy()
        data.qvel[:] = start
        mujoco.mj_comVel(model, data)  # inertial forces have left velocities of bodies at another velocity
        data.qvel[:] = free
        motion = data.cvel, data.subtree_com, model.geom_aabb, model.opt.timestep, data.geom_xmat
        _leave_fast(_contacts(data), self._geometry(), motion, self._carriers(data), near, doubtful)
        return doubtful

    def take_back(self, data: mujoco.MjData, near: np.ndarray, seen: np.ndarray, doubtful: np.ndarray) -> None:
        """See the function `take_back`."""
        _take_back(_contacts(data), near, seen, doubtful)

    def leave_edges(self, data: mujoco.MjData, near: np.ndarray, doubtful: np.ndarray) -> None:
        """See the function `leave_edges`."""
        _leave_edges(_contacts(data), self._geometry(), near, doubtful)

    def pass_over(
        self, data: mujoco.MjData, middle: np.ndarray, near: np.ndarray, seen: np.ndarray, doubtful: np.ndarray
    ) -> None:
        """Take the rows of contacts that bodies pass out of those that the velocity of data closes.

        Args:
            data: the state with current contacts.
            middle: q_M, (nq,).
            near: MuJoCo's rows that take part already, bool (nefc,).
            seen: those that the velocity closes, bool (nefc,); written.
            doubtful: contacts that bodies may pass, bool (ncon,).
        """
        model = self._model
        if self._other is None:
            self._other = mujoco.MjData(model)
        velocity, other = data.qvel.copy(), self._other
        at = model._address, other._address, other.qpos.ctypes.data, velocity.ctypes.data
        _pass_over(
            _contacts(data), self._geometry(), model.geom_aabb, self._carriers(data), sparse_jacobian(model, data),
            velocity, model.opt.timestep, middle, (other.qpos, other.mocap_pos, other.mocap_quat), at, near, seen,
            doubtful,
        )  # fmt: skip

    def _carriers(self, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
        velocity = np.zeros((0, 6)) if self._surfaces is None else self._surfaces.middle_velocity
        return data.mocap_pos, data.mocap_quat, velocity

    def _geometry(self) -> tuple[np.ndarray, ...]:
        m = self._model
        return m.geom_type, m.geom_bodyid, m.body_weldid, m.body_treeid, m.body_rootid, m.body_mocapid


def _contacts(data: mujoco.MjData) -> tuple[np.ndarray, ...]:
    found = data.contact
    return found.dist, found.pos, found.frame, found.geom, found.efc_address
