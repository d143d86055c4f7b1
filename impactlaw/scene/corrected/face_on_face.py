"""MuJoCo's contacts of boxes, corrected: faces that lie on each other, as in a pile.

MuJoCo has a contact at each corner of the part that two faces share, or one where edges touch. Edges that cross in
faces which lie on each other are as near as these faces. Where they just touch, rounding decides between both, and now
and then boxes at rest have a single contact, on which the upper one would tip over.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.corrected.edge_on_face import FLAT, face_along, write_place
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, dot, length, minus, plus, row, times, unit, write

CORNERS = 8
"""Largest number of corners of the part that two faces share."""

_SAME = 1e-7  # distance, relative to the size of the face, up to which two corners are one


@plain
def _clip(corners, many, axis, most, size, clipped):
    """Write the corners of the part of a convex polygon up to a coordinate along an axis; return how many there are."""
    count = 0
    for k in range(many):
        here, following = row(corners, k), row(corners, k + 1 if k + 1 < many else 0)
        inside, then = most - dot(axis, here), most - dot(axis, following)
        for part in range(2):
            point = here
            if part == 1:
                if not (inside < 0.0 < then or then < 0.0 < inside):
                    continue
                point = plus(here, inside / (inside - then), minus(following, here))
            elif inside < 0.0:
                continue
            again = count > 0 and length(minus(point, row(clipped, count - 1))) <= _SAME * size
            if not again and count < CORNERS:
                write(point, clipped[count])
                count += 1
    return count


@plain
def corners_of_faces(shapes, geom, frame, reach, corners, points):
    """Write the contacts of two boxes at the corners of the part that two faces share.

    Gaps are measured along the normal of the face of the first box.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        geom: the two boxes.
        frame: the frame of MuJoCo's only contact, with the normal first, (9,).
        reach: gap from which contacts do not count, m.
        corners: scratch space, (2, CORNERS, 3).
        points: gap, point and frame of each contact, (CORNERS, END), written; see `edge_on_face.END`.

    Returns:
        The number of contacts; 0 if the normal of MuJoCo's contact is not that of a face of each box.
    """
    _, size, place, turn = shapes
    base, top = geom[0], geom[1]
    (face, cosine), (own, upon) = face_along(turn, base, frame), face_along(turn, top, frame)
    normal = times(np.copysign(1.0, cosine), axis_of(turn, base, face))
    if min(abs(cosine), abs(upon)) < FLAT:
        return 0
    i, j = (own + 1) % 3, (own + 2) % 3
    one, other = times(size[top, i], axis_of(turn, top, i)), times(size[top, j], axis_of(turn, top, j))
    middle = minus(row(place, top), row(place, base))
    middle = plus(middle, -np.copysign(size[top, own], upon), axis_of(turn, top, own))
    for k in range(4):  # one after another around the face
        write(plus(plus(middle, 1.0 if k in (0, 3) else -1.0, one), 1.0 if k < 2 else -1.0, other), corners[0, k])
    many, now = 4, 0
    for side in range(4):
        along = (face + 1 + side // 2) % 3
        axis = times(1.0 if side % 2 == 0 else -1.0, axis_of(turn, base, along))
        many = _clip(corners[now], many, axis, size[base, along], length(one) + length(other), corners[1 - now])
        now = 1 - now
    tangent, count = unit(across(axis_of(turn, base, (face + 1) % 3), normal)), 0
    for k in range(many):
        corner = row(corners[now], k)
        gap = dot(normal, corner) - size[base, face]
        if gap < reach:
            points[count, 0] = gap
            write_place(plus(plus(row(place, base), 1.0, corner), -0.5 * gap, normal), normal, tangent, points[count])
            count += 1
    return count
