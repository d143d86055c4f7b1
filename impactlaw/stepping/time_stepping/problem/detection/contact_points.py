"""Move contact points onto the body that moves, and the points of one face into one plane.

MuJoCo puts a contact point halfway between two surfaces. Across a gap that the step closes, the lever of friction on a
ball is then longer than the radius by half the gap. If one of the two bodies has no degrees of freedom, such as a mocap
body, the point is put on the surface of the other body.

The contact points of a foot whose corners differ by 1e-6 m in height are not in one plane. Closing their gaps by a
rotation asks for tangential velocities that differ by 1e-8 m/s. Points that stick cannot have these velocities, and
push each other apart with all the available friction. Only with all points in one plane can a body roll onto the face
and stick at all of them.

Of the corners that two faces share, MuJoCo keeps four which span a large area, and cylinders have corners, too. The
nearest point of two geoms may therefore be missing. It then replaces one of their contacts. Cylinders that touch along
a line have one point of that line (`scene.corrected.side_by_side`).
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.corrected.rounding import make_orthogonal
from impactlaw.scene.corrected.side_by_side import put_between
from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, keep
from impactlaw.stepping.compiled.left_out.hidden_edges import hide_edges

_CAPSULE, _CYLINDER, _BOX, _MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("CAPSULE", "CYLINDER", "BOX", "MESH")
)
_CORNERS = 4  # largest number of corners of a face that MuJoCo keeps
_MISSED = 1e-6  # m: difference of gaps up to which the nearest point may be missing
_TURNED = 0.9998  # cosine of the angle to the normal of the nearest point from which that is used
_PARALLEL = 1e-9  # difference of normals up to which points belong to one face
_LEVEL = 1e-10  # m: distance up to which points are in one plane
_SEEN = 1e-6  # m: smaller gaps change the lever of a single point by a negligible amount
_CLOSED = 1e-4  # m: largest gap of points that are put into one plane; corners farther away touch down one at a time


@plain
def _can_miss(one, other, many, spread):
    """Return whether the nearest point of two shapes can be missing among MuJoCo's points of contact.

    If one of them is round, even a single point can be wrong. Four points of one height are level corners.

    Args:
        one: type of a geom.
        other: type of the other geom.
        many: number of points of contact.
        spread: largest difference of their gaps, m.
    """
    if many == _CORNERS and spread <= _MISSED:
        return False
    long = one in (_CAPSULE, _CYLINDER) or other in (_CAPSULE, _CYLINDER)
    known = one in (_CAPSULE, _CYLINDER, _BOX, _MESH) and other in (_CAPSULE, _CYLINDER, _BOX, _MESH)
    return known and (many > 1 or long) and (one in (_CYLINDER, _MESH) or other in (_CYLINDER, _MESH))


@plain
def _turn(frame, normal):
    """Give a frame, (9,), another normal."""
    along, square = 0.0, 0.0
    for i in range(3):
        along += frame[3 + i] * normal[i]
    for i in range(3):
        frame[i] = normal[i]
        frame[3 + i] -= along * normal[i]
        square += frame[3 + i] ** 2
    for i in range(3):
        frame[3 + i] /= np.sqrt(square)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[6 + i] = frame[j] * frame[3 + k] - frame[k] * frame[3 + j]


@plain
def _replace(first, end, gap, segment, dist, pos, frame):
    """Move the contact that is closest to the nearest point of two geoms there.

    ``segment``, (9,), goes from the first to the second geom, ``gap``, m, is its length; the rest is scratch space.
    """
    nearest, least, along = first, np.inf, 0.0
    for k in range(first, end):
        square = 0.0
        for i in range(3):
            square += (0.5 * (segment[i] + segment[3 + i]) - pos[k, i]) ** 2
        if square < least:
            nearest, least = k, square
    for i in range(3):
        pos[nearest, i] = 0.5 * (segment[i] + segment[3 + i])
        along += (segment[3 + i] - segment[i]) * frame[nearest, i]
    dist[nearest] = along
    if abs(gap) > _MISSED and 0.0 < along / gap < _TURNED:
        dist[nearest] = gap
        for i in range(3):
            segment[6 + i] = (segment[3 + i] - segment[i]) / gap
        _turn(frame[nearest], segment[6:])


@kernel
def add_nearest(dist, pos, frame, geom, shape, margin, at):
    """Replace contacts of two geoms whose nearest point is missing by that point; return whether any is missing.

    Args:
        dist: gaps, m, (ncon,); written, like the next two.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        geom: geoms of contacts, (ncon, 2).
        shape: MuJoCo's geom_type, (ngeom,).
        margin: geom_margin, (ngeom,); half of the sum of two is out of reach, see `margins.write_margins`.
        at: addresses of the model and of its data.
    """
    end, some, segment = 0, False, numbers(9)
    while end < len(dist):
        first, one, other = end, geom[end, 0], geom[end, 1]
        least, most = dist[first], dist[first]
        while end < len(dist) and geom[end, 0] == one and geom[end, 1] == other:
            least, most, end = min(least, dist[end]), max(most, dist[end]), end + 1
        if not _can_miss(shape[one], shape[other], end - first, most - least):
            continue
        bound = min(least - _MISSED, 0.5 * (margin[one] + margin[other]))
        gap = mj.geom_distance(at[0], at[1], one, other, max(bound, APART), address_of(segment))
        if gap < bound:
            some = True
            _replace(first, end, gap, segment, dist, pos, frame)
    keep(segment)
    return some


@plain
def _are_between(geom, body_of_geom, weld, j, k):
    """Return whether two contacts are between the same two bodies; bodies that no joint separates count as one."""
    one, other = weld[body_of_geom[geom[k, 0]]], weld[body_of_geom[geom[k, 1]]]
    return weld[body_of_geom[geom[j, 0]]] == one and weld[body_of_geom[geom[j, 1]]] == other


@plain
def _is_of_face(dist, geom, body_of_geom, weld, k):
    """Return whether another contact between the same two bodies is nearly closed."""
    for step in (-1, 1):
        j = k + step
        while 0 <= j < len(dist) and _are_between(geom, body_of_geom, weld, j, k):
            if abs(dist[j]) <= _CLOSED:
                return True
            j += step
    return False


@plain
def put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree):
    """Move contact points with bodies without degrees of freedom onto the other body; return whether any moves.

    This concerns contacts with friction, except those of one face, which `put_on_planes` handles.

    Args:
        dist: gaps, m, (ncon,).
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).
        dim: MuJoCo's condim of contacts, (ncon,).
        geom: geoms of contacts, (ncon, 2).
        body_of_geom: body of each geom, (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        tree: MuJoCo's body_treeid, -1 for bodies without degrees of freedom, (nbody,).
    """
    moved = False
    for k in range(len(dist)):
        first, second = tree[body_of_geom[geom[k, 0]]] < 0, tree[body_of_geom[geom[k, 1]]] < 0
        if dim[k] == 1 or first == second or abs(dist[k]) <= _SEEN:
            continue
        if abs(dist[k]) > _CLOSED or not _is_of_face(dist, geom, body_of_geom, weld, k):
            moved = True
            for i in range(3):
                pos[k, i] += (0.5 if first else -0.5) * dist[k] * frame[k, i]
    return moved


@plain
def _height(dist, pos, frame, k, near):
    """Return the height of point `near` above point k along the normal, m; infinite if they cannot be in one plane.

    They can if the normals are equal, and point k stays between its two surfaces.
    """
    height = 0.0
    for i in range(3):
        if abs(frame[near, i] - frame[k, i]) > _PARALLEL:
            return np.inf
        height += frame[k, i] * (pos[near, i] - pos[k, i])
    return height if abs(height) <= 0.5 * (abs(dist[k]) + abs(dist[near])) + _LEVEL else np.inf


@plain
def put_on_planes(dist, pos, frame, geom, body_of_geom, weld):
    """Move contact points of two bodies into the plane of the point with the smallest gap; return whether any moves.

    For the arguments see `put_on_bodies`.
    """
    begin, end, moved = 0, 0, False
    for k in range(len(dist)):
        if k == end:
            begin = k
        while end < len(dist) and _are_between(geom, body_of_geom, weld, end, k):
            end += 1
        least, rise = abs(dist[k]), 0.0
        for j in range(begin, end if least <= _CLOSED else begin):
            if abs(dist[j]) < least:
                height = _height(dist, pos, frame, k, j)
                if height != np.inf:
                    least, rise = abs(dist[j]), height
        if abs(rise) > _LEVEL:
            moved = True
            for i in range(3):
                pos[k, i] += rise * frame[k, i]
    return moved


_add_nearest = for_python(add_nearest)


def find_nearest(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Do the same as `add_nearest` with the contacts of data."""
    found, at = data.contact, (model._address, data._address)
    kind, margin = model.geom_type, model.geom_margin
    return bool(_add_nearest(found.dist, found.pos, found.frame, found.geom, kind, margin, at))


@kernel
def mend(contacts, dim, bodies, inertia, shapes, margin, at):
    """Correct contacts; return whether anything was changed.

    Args:
        contacts: gaps, points, frames and geoms of contacts, see `add_nearest`; written.
        dim: MuJoCo's condim of contacts, (ncon,).
        bodies: MuJoCo's geom_bodyid, body_weldid and body_treeid.
        inertia: MuJoCo's body_invweight0 and subtree_com.
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        margin: see `add_nearest`, like the next one.
        at: addresses.
    """
    (dist, pos, frame, geom), (body_of_geom, weld, tree) = contacts, bodies
    nearer = add_nearest(dist, pos, frame, geom, shapes[0], margin, at)
    nearer = put_between(shapes, inertia[0], inertia[1], body_of_geom, weld, geom, pos, frame) or nearer
    turned = make_orthogonal(frame) or nearer
    turned = hide_edges(dist, pos, frame, geom, body_of_geom, weld, tree, shapes, at) or turned
    moved = put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree)
    return put_on_planes(dist, pos, frame, geom, body_of_geom, weld) or moved or turned


mend_contacts = for_python(mend)
"""The form of `mend` that Python calls."""
