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

from impactlaw.compiled import compiled, for_python
from impactlaw.scene.tolerances import MISSES_AXIS, ORTHOGONAL, PARALLEL, ROUNDED, SAME_NORMAL, STANDS, UPRIGHT
from impactlaw.solvers.cones.algebra.loops import plain

_PLANE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX, _MESH, _FIELD = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("BOX", "MESH", "HFIELD"))


@plain
def _product(frame, k, i, j):
    return frame[k, i] * frame[k, j] + frame[k, i + 1] * frame[k, j + 1] + frame[k, i + 2] * frame[k, j + 2]


@plain
def is_orthogonal(frame, k):
    """Return whether the first tangent of contact k is in the tangent plane."""
    return abs(_product(frame, k, 0, 3)) <= ORTHOGONAL


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
        along, some, least = _product(frame, k, 0, 3), True, 0
        for i in range(3):
            frame[k, 3 + i] -= along * frame[k, i]
            least = i if abs(frame[k, i]) < abs(frame[k, least]) else least
        if _product(frame, k, 3, 3) < 0.25:
            for i in range(3):
                frame[k, 3 + i] = (1.0 if i == least else 0.0) - frame[k, least] * frame[k, i]
        length = np.sqrt(_product(frame, k, 3, 3))
        for i in range(3):
            frame[k, 3 + i] /= length
        for i in range(3):  # the second tangent is the vector product of the normal and the first
            a, b = (i + 1) % 3, (i + 2) % 3
            frame[k, 6 + i] = frame[k, a] * frame[k, 3 + b] - frame[k, b] * frame[k, 3 + a]
    return some


straighten = for_python(make_orthogonal)
"""The form of `make_orthogonal` that Python calls."""


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
        cosine, along, out = 0.0, 0.0, 0.0
        for i in range(3):
            cosine += turn[own, 3 * i + 2] * frame[k, i]
            along += turn[own, 3 * i + 2] * (pos[k, i] - place[own, i])
        if abs(cosine) < STANDS:
            continue
        for i in range(3):
            out += (pos[k, i] - place[own, i] - along * turn[own, 3 * i + 2]) ** 2
        scale, end, gap = size[own, 0] / np.sqrt(out), np.sign(along) * size[own, 1], 0.0
        end -= scale * along
        for i in range(3):
            point = place[own, i] + end * turn[own, 3 * i + 2] + scale * (pos[k, i] - place[own, i])
            gap += (point - place[plane, i]) * frame[k, i]
        if abs(gap - dist[k]) <= ROUNDED:
            continue
        changed, dist[k] = True, gap
        for i in range(3):
            point = place[own, i] + end * turn[own, 3 * i + 2] + scale * (pos[k, i] - place[own, i])
            pos[k, i] = point - 0.5 * gap * frame[k, i]
    return changed


measure_again = for_python(measure_standing)
"""The form of `measure_standing` that Python calls."""


@plain
def _is_on_face(kind, turn, geom, frame, k, other):
    """Return whether a contact is one of several on a face of the geom ``other``; the normals of edges are vague."""
    for j in (k - 1, k + 1):
        if 0 <= j < len(geom) and geom[j, 0] == geom[k, 0] and geom[j, 1] == geom[k, 1]:
            turned, along = 0.0, 0.0
            for i in range(3):
                turned = max(turned, abs(frame[j, i] - frame[k, i]))
                straight = 0.0
                for m in range(3):
                    straight += turn[other, 3 * m + i] * frame[k, m]
                along = max(along, abs(straight))
            return turned <= SAME_NORMAL and (kind[other] != _BOX or along >= 1.0 - SAME_NORMAL)
    return False


@plain
def _is_inside_face(size, place, turn, other, pos, frame, k, edge):
    """Return whether a contact point is on a face of a box, farther than ``edge``, m, from the edges of the face."""
    faces, inside = 0, 0
    for i in range(3):
        along, way = 0.0, 0.0
        for m in range(3):
            along += turn[other, 3 * m + i] * frame[k, m]
            way += turn[other, 3 * m + i] * (pos[k, m] - place[other, m])
        if abs(along) >= 1.0 - SAME_NORMAL:
            faces += 1
        elif abs(way) < size[other, i] - edge:
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
        cosine, miss = 0.0, 0.0
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            cosine += turn[own, 3 * i + 2] * frame[k, i]
            aside = turn[own, 3 * a + 2] * frame[k, b] - turn[own, 3 * b + 2] * frame[k, a]
            miss += aside * (pos[k, i] - place[own, i])
        square = 1.0 - cosine * cosine
        far = MISSES_AXIS * size[own, 0] * np.sqrt(square)  # beyond, it is the normal that is wrong
        if abs(cosine) > PARALLEL or abs(miss) <= ROUNDED or abs(miss) > far:
            continue
        moved = True
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            aside = turn[own, 3 * a + 2] * frame[k, b] - turn[own, 3 * b + 2] * frame[k, a]
            pos[k, i] -= aside * miss / square
    return moved


put_on_axes = for_python(meet_axes)
"""The form of `meet_axes` that Python calls."""


@plain
def upright(turn, plane, own, least):
    """Return 1 if a cylinder's axis is the normal of a plane, -1 if it is the opposite, 0 if the cylinder is tilted.

    It counts as tilted from a tilt whose sine is ``least``.
    """
    cosine, tilt = 0.0, 0.0
    for i in range(3):
        cosine += turn[plane, 3 * i + 2] * turn[own, 3 * i + 2]
    for i in range(3):
        tilt += (turn[own, 3 * i + 2] - cosine * turn[plane, 3 * i + 2]) ** 2
    return np.sign(cosine) if tilt < least * least else 0.0


@compiled()
def align(planes, cylinders, turn):
    """Turn the axes of cylinders into the normal of a plane if the angle between them is no more than rounding."""
    for plane in planes:
        for own in cylinders:
            sign = upright(turn, plane, own, UPRIGHT)
            for i in range(3 if sign != 0.0 else 0):
                turn[own, 3 * i + 2] = sign * turn[plane, 3 * i + 2]
