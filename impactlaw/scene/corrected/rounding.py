"""MuJoCo's contacts, corrected: those of capsules and cylinders where they consist of rounding errors.

Contact frames are made orthogonal, so that friction acts in the tangent plane. MuJoCo aligns the first tangent of a
contact between a capsule and a plane with the axis of the capsule. If the axis is the normal, this tangent consists of
rounding errors and has a normal part. Friction would then act like a normal impulse.

The normal of a contact on the side or the rim of a cylinder meets its axis. MuJoCo's points on faces of boxes and
meshes miss it by up to a percent of the radius, since all points nearby are almost equally near. A cylinder that lies
on a table would roll away, and one whose rim hits a wall would spin: its contact points are moved to where the normal
meets the axis. A single point on a mesh stays where it is, since it may be on an edge.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.tolerances import MISSES_AXIS, ORTHOGONAL, PARALLEL, ROUNDED, SAME_NORMAL, UPRIGHT
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit, write

_PLANE, _CYLINDER, _BOX, _MESH, _FIELD = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "BOX", "MESH", "HFIELD")
)


@plain
def is_orthogonal(frame, k):
    """Return whether the first tangent of contact k is in the tangent plane."""
    return abs(dot(frame[k], frame[k, 3:])) <= ORTHOGONAL


@plain
def make_orthogonal(frame):
    """Replace the tangents of contacts whose first tangent is not in the tangent plane; return whether there are any.

    The new tangent is the projection of the old one onto the plane, if that is more than rounding.

    Args:
        frame: normals and two tangents each, (ncon, 9); tangents are written.
    """
    some = False
    for k in range(len(frame)):
        if is_orthogonal(frame, k):
            continue
        normal, some, least = row(frame, k), True, 0
        for i in range(3):
            least = i if abs(normal[i]) < abs(normal[least]) else least
        tangent = across(frame[k, 3:], normal)
        if dot(tangent, tangent) < 0.25:
            tangent = times(-normal[least], normal)
            tangent = plus(tangent, 1.0, (1.0 * (least == 0), 1.0 * (least == 1), 1.0 * (least == 2)))
        tangent = unit(tangent)
        write(tangent, frame[k, 3:])
        write(cross(normal, tangent), frame[k, 6:])
    return some


@plain
def _is_on_face(kind, turn, geom, frame, k, other):
    """Return whether a contact is one of several on a face of the geom ``other``; the normals of edges are vague."""
    for j in (k - 1, k + 1):
        if 0 <= j < len(geom) and geom[j, 0] == geom[k, 0] and geom[j, 1] == geom[k, 1]:
            turned, along = 0.0, 0.0
            for i in range(3):
                turned = max(turned, abs(frame[j, i] - frame[k, i]))
                along = max(along, abs(dot(axis_of(turn, other, i), frame[k])))
            return turned <= SAME_NORMAL and (kind[other] != _BOX or along >= 1.0 - SAME_NORMAL)
    return False


@plain
def _is_inside_face(size, place, turn, other, pos, frame, k, edge):
    """Return whether a contact point is on a face of a box, farther than ``edge``, m, from the edges of the face."""
    faces, inside, arm = 0, 0, minus(row(pos, k), row(place, other))
    for i in range(3):
        axis = axis_of(turn, other, i)
        if abs(dot(axis, frame[k])) >= 1.0 - SAME_NORMAL:
            faces += 1
        elif abs(dot(axis, arm)) < size[other, i] - edge:
            inside += 1
    return faces == 1 and inside == 2


@plain
def meet_axes(kind, size, place, turn, geom, pos, frame):
    """Move contact points of cylinders on faces along these so that normals meet the axes.

    Return whether any moves. Contacts of the flat ends of cylinders stay as they are.

    Args:
        kind: types of geoms, (ngeom,).
        size: their sizes, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9).
        geom: geoms of contacts, (ncon, 2).
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).
    """
    moved = False
    for k in range(len(pos)):
        own, other = geom[k, 0], geom[k, 1]
        if own >= 0 and other >= 0 and kind[own] != _CYLINDER:
            own, other = other, own
        if own < 0 or other < 0 or kind[own] != _CYLINDER:
            continue
        if kind[other] != _BOX and kind[other] != _MESH and kind[other] != _FIELD:
            continue
        inside = kind[other] == _BOX and _is_inside_face(
            size, place, turn, other, pos, frame, k, MISSES_AXIS * size[own, 0]
        )
        if not inside and not _is_on_face(kind, turn, geom, frame, k, other):
            continue
        axis, normal, point = axis_of(turn, own, 2), row(frame, k), row(pos, k)
        cosine, aside = dot(axis, normal), cross(axis, normal)
        miss, square = dot(aside, minus(point, row(place, own))), 1.0 - cosine * cosine
        far = MISSES_AXIS * size[own, 0] * np.sqrt(square)  # beyond, it is the normal that is wrong
        if abs(cosine) <= PARALLEL and ROUNDED < abs(miss) <= far:
            moved = True
            write(plus(point, -miss / square, aside), pos[k])
    return moved


@plain
def align(kind, turn):
    """Turn the axes of cylinders into the normal of a plane if the angle between them is no more than rounding.

    MuJoCo looks for the lowest point of the rim. If the axis is tilted by an angle a, the height of that point has an
    error of some 1e-16 / a times the radius: a cylinder at rest on its face may have no contact at all.

    Return whether any axis is turned.

    Args:
        kind: types of geoms, (ngeom,).
        turn: their rotation matrices, (ngeom, 9); written.
    """
    some = False
    for plane in range(len(kind)):
        for own in range(len(kind) if kind[plane] == _PLANE else 0):
            axis, normal = axis_of(turn, own, 2), axis_of(turn, plane, 2)
            tilt, sign = across(axis, normal), np.sign(dot(axis, normal))
            for i in range(3 if kind[own] == _CYLINDER and dot(tilt, tilt) < UPRIGHT * UPRIGHT else 0):
                some, turn[own, 3 * i + 2] = True, sign * normal[i]
    return some
