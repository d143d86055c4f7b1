"""Leave open contacts of fast bodies out at first: bodies may miss each other although the gradient says that they hit.

The gap to an edge, or to another ball, that a fast ball flies past closes along its gradient. Contacts are therefore
doubtful if bodies move along each other by more than a quarter of their half thickness in a timestep, or by more than a
hundredth of their gap if both have edges. Whether they close is measured, see `passed_edges`. Those that overlap with
the velocity without contact take part from the beginning.
"""

from __future__ import annotations

import mujoco

from impactlaw.scene.tolerances import TOUCHING
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, minus, plus, row
from impactlaw.stepping.compiled.access import contact_ints, contacts_of, data_floats, model_floats, model_ints, size
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carried, carrier_of
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, move_bodies, setting

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
def can_pass(w, pair):
    """Return whether a geom can pass another one."""
    shape, can = model_ints(w, MODEL.geom_type, size(w, MODEL.ngeom)), True
    for i in range(2):
        can = can and shape[pair[i]] != _PLANE and shape[pair[i]] != _SDF
    return can


@plain
def _has_edge(w, g, frame):
    """Return whether a contact can be at an edge of a geom: at a box or a mesh, and off the side of a cylinder."""
    n = size(w, MODEL.ngeom)
    kind = model_ints(w, MODEL.geom_type, n)[g]
    if kind == _CYLINDER:
        return abs(dot(axis_of(data_floats(w, DATA.geom_xmat, (n, 9)), g, 2), frame)) > _SIDE
    return kind == _BOX or kind == _MESH


@plain
def thickness(w, g):
    """Return half the smallest size of the box around a geom, m."""
    extent = model_floats(w, MODEL.geom_aabb, (size(w, MODEL.ngeom), 6))
    return min(extent[g, 3], extent[g, 4], extent[g, 5])


@plain
def _velocity(w, g, point):
    """Return the velocity of a point of a geom, m/s."""
    n, b = size(w, MODEL.nbody), model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom))[g]
    velocity, center = data_floats(w, DATA.cvel, (n, 6)), data_floats(w, DATA.subtree_com, (n, 3))
    arm = minus(point, row(center, model_ints(w, MODEL.body_rootid, n)[b]))
    own = plus(velocity[b, 3:], 1.0, cross(velocity[b], arm))
    return plus(own, 1.0, carried(w, carrier_of(w, g), point, ROW.now))


@plain
def _is_fast(w, pair, gap, point, frame):
    """Return whether two geoms move along each other by a long way in a timestep, see `_FAST` and `_BESIDE`."""
    v = minus(_velocity(w, pair[1], point), _velocity(w, pair[0], point))
    along, way = dot(v, frame), _FAST * min(thickness(w, pair[0]), thickness(w, pair[1]))
    if gap > _NEARLY and _has_edge(w, pair[0], frame) and _has_edge(w, pair[1], frame):
        way = min(way, _BESIDE * gap)
    return w.timestep * w.timestep * (dot(v, v) - along * along) > way * way


@plain
def _is_left(w, k, chosen):
    """Return whether a contact is left out if bodies are fast."""
    (gap, _, _, geom), row = contacts_of(w), contact_ints(w, CONTACT.efc_address, 1)[k, 0]
    return gap[k] > TOUCHING and row >= 0 and chosen[row] and can_pass(w, geom[k])


@plain
def some_can_pass(w, chosen):
    """Return whether `leave_fast` leaves any contact out if bodies are fast."""
    some = False
    for k in range(len(contacts_of(w)[0])):
        some = some or _is_left(w, k, chosen)
    return some


@plain
def leave_fast(w, start, chosen, doubtful):
    """Leave contacts out of bodies that move fast along each other and may miss; return whether there are any.

    Args:
        w: the world in the middle of the step.
        start: velocity at the start, (nv,).
        chosen: MuJoCo's rows that take part, bool (nefc,); written.
        doubtful: the contacts that are left out, bool (ncon,), False; written.
    """
    if setting(w, SETTING.inertial) != 0.0:
        move_bodies(w, start)  # inertial forces have left velocities of bodies at another velocity
    some, (gap, point, frame, geom), address = False, contacts_of(w), contact_ints(w, CONTACT.efc_address, 1)
    for k in range(len(gap)):
        if _is_left(w, k, chosen) and _is_fast(w, geom[k], gap[k], point[k], frame[k]):
            doubtful[k], chosen[address[k, 0]], some = True, False, True
    return some


@plain
def take_back(w, chosen, seen, doubtful):
    """Let contacts take part that the velocity without contact closes, see `passed_edges.pass_over`."""
    address = contact_ints(w, CONTACT.efc_address, 1)
    for k in range(len(address)):
        if doubtful[k] and seen[address[k, 0]]:
            doubtful[k], chosen[address[k, 0]] = False, True
