"""MuJoCo's contacts of boxes, corrected: an edge of one box that lies along a face of another, as a crate on a rail.

MuJoCo has contacts at both ends of that line only if edge and face are parallel to some 1e-6, and else only the one at
the lower end. A box that rests on it would roll from end to end, and collide in every step. It therefore gets a contact
at the other end, too, with the normal of the face, along which its gap is measured.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.tolerances import PARALLEL, SIDE_BY_SIDE
from impactlaw.solvers.cones.algebra.loops import plain

_SHORT = 1e-3  # length of the line, relative to that of the edge, up to which it is a point
_NEARER = 1e-6  # m: by which the other end can be nearer than MuJoCo's contact, because of rounding


@plain
def _along(turn, box, i, frame):
    return turn[box, i] * frame[0] + turn[box, 3 + i] * frame[1] + turn[box, 6 + i] * frame[2]


@plain
def _face(turn, box, frame):
    """Return the axis of a box that is most parallel to the normal of a contact, and the cosine of their angle."""
    most, cosine = 0, _along(turn, box, 0, frame)
    for i in range(1, 3):
        other = _along(turn, box, i, frame)
        if abs(other) > abs(cosine):
            most, cosine = i, other
    return most, cosine


@plain
def _edge(turn, box, frame):
    """Return the axis of a box that is most perpendicular to the normal of a contact."""
    least = 0
    for i in range(1, 3):
        if abs(_along(turn, box, i, frame)) < abs(_along(turn, box, least, frame)):
            least = i
    return least


@plain
def _middle(shapes, box, edge, point):
    """Return the middle of the edge of a box, along an axis of it, that is nearest to a point."""
    _, size, place, turn = shapes
    middle = place[box, 0], place[box, 1], place[box, 2]
    for i in range(3):
        if i != edge:
            side = 0.0
            for k in range(3):
                side += turn[box, 3 * k + i] * (point[k] - place[box, k])
            out = np.copysign(size[box, i], side)
            middle = (
                middle[0] + out * turn[box, i], middle[1] + out * turn[box, 3 + i], middle[2] + out * turn[box, 6 + i]
            )  # fmt: skip
    return middle


@plain
def _overlay(shapes, box, face, middle, along, half):
    """Return the part of an edge that is above or below a face of a box, as coordinates along the edge, m."""
    (_, size, place, turn), low, high = shapes, -half, half
    for i in range(3):
        if i == face:
            continue
        start, rate = 0.0, 0.0
        for k in range(3):
            start += turn[box, 3 * k + i] * (middle[k] - place[box, k])
            rate += turn[box, 3 * k + i] * along[k]
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
        end: gap, point and frame of the other contact, (13,), written.

    Returns:
        0.0 if there is no such line, else 1.0 or -1.0: whether the other end is on the positive side of the edge.
    """
    _, size, place, turn = shapes
    top, base, toward = geom[0], geom[1], 1.0
    face, cosine = _face(turn, base, frame)
    own, across = _face(turn, top, frame)
    if abs(across) > abs(cosine):
        top, base, toward, face, cosine = base, top, -1.0, own, across
    edge = _edge(turn, top, frame)
    along = turn[top, edge], turn[top, 3 + edge], turn[top, 6 + edge]
    slope = 0.0
    for k in range(3):
        slope += turn[base, 3 * k + face] * along[k]
    if abs(cosine) < PARALLEL or abs(slope) > SIDE_BY_SIDE:
        return 0.0
    middle = _middle(shapes, top, edge, pos)
    low, high = _overlay(shapes, base, face, middle, along, size[top, edge])
    at = 0.0
    for k in range(3):
        at += along[k] * (pos[k] - middle[k])
    far = low if at - low > high - at else high
    if high - low < _SHORT * size[top, edge] or abs(far - at) < 0.5 * (high - low):
        return 0.0
    sign = np.copysign(1.0, cosine)  # the normal is sign times the axis of the face
    gap, tilt = -size[base, face], sign * slope
    for k in range(3):
        gap -= toward * sign * turn[base, 3 * k + face] * (middle[k] + far * along[k] - place[base, k])
    if gap < dist - _NEARER:
        return 0.0
    end[0], length = gap, np.sqrt(1.0 - tilt * tilt)
    for k in range(3):
        end[4 + k] = sign * turn[base, 3 * k + face]
        end[1 + k] = middle[k] + far * along[k] + 0.5 * toward * gap * end[4 + k]
        end[7 + k] = (along[k] - tilt * end[4 + k]) / length
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        end[10 + k] = end[4 + i] * end[7 + j] - end[4 + j] * end[7 + i]
    return 1.0 if far > at else -1.0
