"""Leave open contacts of fast bodies out at first: bodies may miss each other although the gradient says that they hit.

The gap to an edge, or to another ball, that a fast ball flies past closes along its gradient. Contacts are therefore
doubtful if bodies move along each other by more than a quarter of their half thickness in a timestep, or by more than a
hundredth of their gap if both have edges. Whether they close is measured, see `passed_edges`. Those that overlap with
the velocity without contact take part from the beginning.
"""

from __future__ import annotations

import mujoco

from impactlaw.scene.tolerances import TOUCHING
from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, minus, plus, row
from impactlaw.stepping.time_stepping.problem.detection.carriers import carried

_PLANE, _CYLINDER, _BOX, _MESH, _SDF = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "BOX", "MESH", "SDF")
)
_FAST = 0.25
"""Way of bodies along each other in a timestep, relative to half the thickness of the thinner one, that is long ..."""
_BESIDE = 1e-2
"""... or relative to their gap, if both have edges: as these come nearer, the gradient of the gap turns at once."""
_SIDE = 1e-3
"""Cosine of the angle between a normal and the axis of a cylinder up to which its side is met."""
_NEARLY = 1e-5
"""Gap, m, up to which bodies nearly touch: they may slide on each other."""


@plain
def can_pass(pair, shape):
    """Return whether a geom can pass another one."""
    can = True
    for i in range(2):
        can = can and shape[pair[i]] != _PLANE and shape[pair[i]] != _SDF
    return can


@plain
def _has_edge(g, frame, shape, turned):
    """Return whether a contact can be at an edge of a geom: at a box or a mesh, and off the side of a cylinder."""
    if shape[g] == _CYLINDER:
        return abs(dot(axis_of(turned, g, 2), frame)) > _SIDE
    return shape[g] == _BOX or shape[g] == _MESH


@plain
def thickness(g, extent):
    """Return half the smallest size of the box around a geom, m."""
    return min(extent[g, 3], extent[g, 4], extent[g, 5])


@plain
def _velocity(g, point, geometry, motion, carriers):
    """Return the velocity of a point of a geom, m/s."""
    (_, body_of_geom, _, _, root, _), (velocity, center, _, _, _) = geometry, motion
    b = body_of_geom[g]
    own = plus(velocity[b, 3:], 1.0, cross(velocity[b], minus(point, row(center, root[b]))))
    return plus(own, 1.0, carried(g, point, geometry, carriers))


@plain
def _is_fast(pair, gap, point, frame, geometry, motion, carriers):
    """Return whether two geoms move along each other by a long way in a timestep, see `_FAST` and `_BESIDE`."""
    (_, _, extent, timestep, turned), shape = motion, geometry[0]
    v = _velocity(pair[1], point, geometry, motion, carriers)
    v = minus(v, _velocity(pair[0], point, geometry, motion, carriers))
    along = dot(v, frame)
    way = _FAST * min(thickness(pair[0], extent), thickness(pair[1], extent))
    edges = _has_edge(pair[0], frame, shape, turned) and _has_edge(pair[1], frame, shape, turned)
    if edges and gap > _NEARLY:
        way = min(way, _BESIDE * gap)
    return timestep * timestep * (dot(v, v) - along * along) > way * way


@plain
def _is_left(k, contacts, shape, chosen):
    """Return whether a contact is left out if bodies are fast."""
    gap, _, _, geom, address = contacts
    return gap[k] > TOUCHING and address[k] >= 0 and chosen[address[k]] and can_pass(geom[k], shape)


@plain
def some_can_pass(contacts, shape, chosen):
    """Return whether `leave_fast` leaves any contact out if bodies are fast; for the arguments see there."""
    some = False
    for k in range(len(contacts[0])):
        some = some or _is_left(k, contacts, shape, chosen)
    return some


@kernel
def leave_fast(contacts, geometry, motion, carriers, chosen, doubtful):
    """Leave contacts out of bodies that move fast along each other and may miss; return whether there are any.

    Args:
        contacts: gaps, m, (ncon,), points, (ncon, 3), frames with normals first, at least (ncon, 3), geoms, (ncon, 2),
            and first rows, (ncon,).
        geometry: MuJoCo's geom_type, geom_bodyid, body_weldid, body_treeid, body_rootid and body_mocapid.
        motion: MuJoCo's cvel, subtree_com and geom_aabb, h, s, and geom_xmat.
        carriers: mocap bodies, see `carriers.carried`.
        chosen: MuJoCo's rows that take part, bool (nefc,); written.
        doubtful: the contacts that are left out, bool (ncon,), False; written.
    """
    some, (gap, point, frame, geom, address) = False, contacts
    for k in range(len(gap)):
        left = _is_left(k, contacts, geometry[0], chosen)
        if left and _is_fast(geom[k], gap[k], point[k], frame[k], geometry, motion, carriers):
            doubtful[k], chosen[address[k]], some = True, False, True
    return some


@kernel
def take_back(contacts, chosen, seen, doubtful):
    """Let contacts take part that the velocity without contact closes, see `passed_edges.pass_over`."""
    address = contacts[4]
    for k in range(len(address)):
        if doubtful[k] and seen[address[k]]:
            doubtful[k], chosen[address[k]] = False, True
