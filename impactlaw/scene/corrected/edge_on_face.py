"""MuJoCo's contacts of boxes, corrected: an edge of one box that lies along a face of another, as a crate on a rail.

MuJoCo has contacts at both ends of that line only if edge and face are parallel to some 1e-6, and else only the one at
the lower end. A box that rests on it would roll from end to end, and collide in every step. It therefore gets a contact
at the other end, too, with the normal of the face, along which its gap is measured.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.tolerances import PARALLEL, SIDE_BY_SIDE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit, write

FLAT = 1.0 - 5e-7  # cosine of the angle, 1e-3, up to which faces lie on each other, see `face_on_face`
_SHORT = 1e-3  # length of the line, relative to that of the edge, up to which it is a point
_NEARER = 1e-6  # m: by which the other end can be nearer than MuJoCo's contact, because of rounding
END = 13
"""Numbers of an end: its gap, m, its point, m, and its frame, as MuJoCo's."""


@plain
def write_place(point, normal, tangent, end):
    """Write point and frame of a contact; see `END`."""
    write(point, end[1:])
    write(normal, end[4:])
    write(tangent, end[7:])
    write(cross(normal, tangent), end[10:])


@plain
def face_along(turn, box, normal):
    """Return the axis of a box that is most parallel to a normal, and the cosine of their angle."""
    most, cosine = 0, dot(axis_of(turn, box, 0), normal)
    for i in range(1, 3):
        other = dot(axis_of(turn, box, i), normal)
        if abs(other) > abs(cosine):
            most, cosine = i, other
    return most, cosine


@plain
def _edge(turn, box, normal):
    """Return the axis of a box that is most perpendicular to a normal."""
    least = 0
    for i in range(1, 3):
        if abs(dot(axis_of(turn, box, i), normal)) < abs(dot(axis_of(turn, box, least), normal)):
            least = i
    return least


@plain
def _middle(shapes, box, edge, point):
    """Return the middle of the edge of a box, along an axis of it, that is nearest to a point."""
    _, size, place, turn = shapes
    middle = row(place, box)
    for i in range(3):
        if i != edge:
            axis = axis_of(turn, box, i)
            side = dot(axis, minus(point, row(place, box)))
            middle = plus(middle, np.copysign(size[box, i], side), axis)
    return middle


@plain
def _overlay(shapes, box, face, middle, along, half):
    """Return the part of an edge that is above or below a face of a box, as coordinates along the edge, m."""
    (_, size, place, turn), low, high = shapes, -half, half
    for i in range(3):
        if i == face:
            continue
        axis = axis_of(turn, box, i)
        start, rate = dot(axis, minus(middle, row(place, box))), dot(axis, along)
        if abs(rate) * half < _SHORT * size[box, i]:
            if abs(start) > size[box, i]:
                return 0.0, 0.0
        else:
            one, other = (-size[box, i] - start) / rate, (size[box, i] - start) / rate
            low, high = max(low, min(one, other)), min(high, max(one, other))
    return low, high


@plain
def other_end(shapes, geom, dist, pos, frame, end):
    """Write the contact at the other end of the line along which an edge of one box lies on a face of another.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        geom: the two boxes.
        dist: the gap of MuJoCo's only contact, m.
        pos: its point, m, (3,).
        frame: its frame, with the normal first, (9,).
        end: gap, point and frame of the other contact, (END,), written.

    Returns:
        0.0 if there is no such line, or faces lie on each other, else 1.0 or -1.0: whether the other end is on the
        positive side of the edge.
    """
    _, size, place, turn = shapes
    top, base, toward = geom[0], geom[1], 1.0
    face, cosine = face_along(turn, base, frame)
    own, upon = face_along(turn, top, frame)
    if min(abs(cosine), abs(upon)) >= FLAT:
        return 0.0
    if abs(upon) > abs(cosine):
        top, base, toward, face, cosine = base, top, -1.0, own, upon
    edge = _edge(turn, top, frame)
    along, axis = axis_of(turn, top, edge), axis_of(turn, base, face)
    slope = dot(axis, along)
    if abs(cosine) < PARALLEL or abs(slope) > SIDE_BY_SIDE:
        return 0.0
    middle = _middle(shapes, top, edge, pos)
    low, high = _overlay(shapes, base, face, middle, along, size[top, edge])
    at = dot(along, minus(pos, middle))
    far = low if at - low > high - at else high
    if high - low < _SHORT * size[top, edge] or abs(far - at) < 0.5 * (high - low):
        return 0.0
    normal, point = times(np.copysign(1.0, cosine), axis), plus(middle, far, along)
    gap = -size[base, face] - toward * dot(normal, minus(point, row(place, base)))
    if gap < dist - _NEARER:
        return 0.0
    end[0] = gap
    write_place(plus(point, 0.5 * toward * gap, normal), normal, unit(across(along, normal)), end)
    return 1.0 if far > at else -1.0
