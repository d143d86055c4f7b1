"""MuJoCo's contacts, corrected: those of capsules and cylinders where they consist of rounding errors.

Contact frames are made orthogonal, so that friction acts in the tangent plane. MuJoCo aligns the first tangent of a
contact between a capsule and a plane with the axis of the capsule. If the axis is the normal, this tangent consists of
rounding errors and has a normal part. Friction would then act like a normal impulse.

Distances of cylinders that stand on a plane are measured again. MuJoCo looks for the lowest point of the rim. If the
axis is tilted by an angle a from the normal, the height of that point has an error of some 1e-16 / a times the radius:
a cylinder at rest on its face would be lifted and dropped, and may have no contact at all.

The normal of a contact on the side or the rim of a cylinder meets its axis. MuJoCo's points on faces of boxes and
meshes miss it by up to a percent of the radius, since all points nearby are almost equally near. A cylinder that lies
on a table would roll away, and one whose rim hits a wall would spin: its contact points are moved to where the normal
meets the axis. A single point on a mesh stays where it is, since it may be on an edge.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.scene.tolerances import (
    GAP_TOLERANCE,
    MISSES_AXIS,
    ORTHOGONAL,
    PARALLEL,
    ROUNDED,
    SAME_NORMAL,
    STANDS,
    UPRIGHT,
)
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit, write

_PLANE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX, _MESH, _FIELD = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("BOX", "MESH", "HFIELD"))


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
def measure_standing(kind, size, place, turn, geom, dist, pos, frame):
    """Measure again the gaps of cylinders that stand on planes, at the points of their rims; move the points halfway.

    Return whether any gap changes.

    Args:
        kind: types of geoms, (ngeom,).
        size: their sizes, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9).
        geom: geoms of contacts, the plane first, (ncon, 2).
        dist: gaps, m, (ncon,); written.
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).
    """
    changed = False
    for k in range(len(dist)):
        plane, own = geom[k, 0], geom[k, 1]
        if plane < 0 or own < 0 or kind[plane] != _PLANE or kind[own] != _CYLINDER:
            continue
        axis, normal, center = axis_of(turn, own, 2), row(frame, k), row(place, own)
        arm, cosine = minus(row(pos, k), center), dot(axis, normal)
        if abs(cosine) < STANDS:
            continue
        along, out = dot(axis, arm), across(arm, axis)
        scale = size[own, 0] / np.sqrt(dot(out, out))
        end = np.sign(along) * size[own, 1] - scale * along
        point = plus(plus(center, end, axis), scale, arm)
        gap = dot(minus(point, row(place, plane)), normal)
        if abs(gap - dist[k]) > ROUNDED:
            changed, dist[k] = True, gap
            write(plus(point, -0.5 * gap, normal), pos[k])
    return changed


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

    Return whether any moves. Contacts of the flat ends of cylinders stay as they are. For the arguments see
    `measure_standing`; ``pos`` is written.
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
def upright(turn, plane, own, least):
    """Return 1 if a cylinder's axis is the normal of a plane, -1 if it is the opposite, 0 if the cylinder is tilted.

    It counts as tilted from a tilt whose sine is ``least``.
    """
    normal, axis = axis_of(turn, plane, 2), axis_of(turn, own, 2)
    cosine, tilt = dot(normal, axis), across(axis, normal)
    return np.sign(cosine) if dot(tilt, tilt) < least * least else 0.0


@compiled()
def align(planes, cylinders, size, turn):
    """Turn the axes of cylinders into the normal of a plane if the angle between them is no more than rounding.

    Return the planes and cylinders, (k, 2), that touch with the whole rim, if at all.
    """
    standing, count = np.empty((len(planes) * len(cylinders), 2), np.int32), 0
    for plane in planes:
        for own in cylinders:
            if upright(turn, plane, own, 0.5 * GAP_TOLERANCE / size[own, 0]) == 0.0:
                continue
            standing[count, 0], standing[count, 1] = plane, own
            count, sign = count + 1, upright(turn, plane, own, UPRIGHT)
            for i in range(3 if sign != 0.0 else 0):
                turn[own, 3 * i + 2] = sign * turn[plane, 3 * i + 2]
    return standing[:count]
