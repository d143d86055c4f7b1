"""Contact points of cylinders that stand or rock on flat faces: on planes, boxes, and ends of other cylinders.

MuJoCo's points on planes are the lowest one of the rim, and two more such that the three are corners of a triangle. On
boxes and cylinders they are corners of a polygon in the rim, and where the axis is the normal up to rounding, they and
their gaps consist of rounding errors. A cylinder that can stand would roll over the edge of such a polygon, and one
that rocks would not land on the opposite point of its rim: others would be hit in its place, and too little energy
lost.

Here they are the corners of a square on the rim. One is the lowest point; where the whole rim is closed, it is where
velocity and gravity tip the cylinder. Where the rim reaches beyond the face, both ends of each edge of the face that is
below the rim take the place of corners. The cylinder then tips over the same line or point as its whole end would.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.corrected.edge_on_face import face_along, write_place
from impactlaw.scene.tolerances import OUT_OF_REACH, PARALLEL
from impactlaw.solvers.cones.algebra.loops import plain, put
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, length, minus, plus, row, times, unit

ROOM = 12
"""Largest number of contacts of a cylinder on a face: four corners, and two ends of each edge."""
_PLANE, _CYLINDER, _BOX = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "BOX"))
_SLOW = 1e-9  # m/s: speed up to which a velocity has no direction
_WEAK = 1e-9  # m/s^2: gravity along the face up to which it has no direction
_SAME = 1e-9  # distance, relative to the radius, up to which rims are the same


@plain
def _tip(normal, size, spin, velocity, gravity, else_to):
    """Return the direction along a face, of length 1, in which a cylinder that stands on it tips.

    The force that would stop the upper one of both acts in this direction from the axis.
    """
    lever, square = size[1], 0.25 * size[0] ** 2 + size[1] ** 2 / 3.0
    lever = -lever if dot(normal, gravity) > 0.0 else lever
    way = across(plus(times(lever, velocity), square, cross(spin, normal)), normal)
    if not dot(way, way) > (_SLOW * lever) ** 2:
        way = across(gravity, normal)
        if not dot(way, way) > _WEAK**2:
            way = across(else_to, normal)
    return unit(way)


@plain
def relative_motion(bodies, geom, at):
    """Return the angular velocity and velocity, at a point, of the second body of a contact relative to the first.

    Args:
        bodies: MuJoCo's geom_bodyid, body_rootid, cvel, (nbody, 6), and subtree_com, (nbody, 3).
        geom: the geoms of the contact, which are no flexes.
        at: the point.
    """
    of, root, velocity, com = bodies
    a, b = of[geom[0]], of[geom[1]]
    one, other = cross(velocity[a], minus(at, row(com, root[a]))), cross(velocity[b], minus(at, row(com, root[b])))
    return minus(velocity[b], velocity[a]), plus(minus(velocity[b, 3:], velocity[a, 3:]), 1.0, minus(other, one))


@plain
def stand(shapes, geom, frame, gravity):
    """Return the cylinder whose end is on a flat face in a contact, the geom with the face, and the normal out of it.

    The cylinder is -1 if there is none. For the arguments see `find_corners`, here of one contact.
    """
    (kind, _, _, turn), base, own, none = shapes, geom[0], geom[1], (0.0, 0.0, 0.0)
    if base < 0 or own < 0 or (kind[base] != _CYLINDER and kind[own] != _CYLINDER):
        return -1, -1, none
    if kind[own] != _CYLINDER or (kind[base] == _CYLINDER and dot(frame, gravity) > 0.0):
        base, own = own, base
    if kind[base] != _PLANE and kind[base] != _BOX and kind[base] != _CYLINDER:
        return -1, -1, none
    face = face_along(turn, base, frame)[0] if kind[base] == _BOX else 2
    normal, axis = axis_of(turn, base, face), axis_of(turn, own, 2)
    if abs(dot(normal, frame)) < PARALLEL or abs(dot(axis, frame)) < PARALLEL:
        return -1, -1, none
    toward = np.copysign(1.0, dot(normal, frame)) * (1.0 if base == geom[0] else -1.0)
    return own, base, times(toward, normal)


@plain
def some_stand(shapes, geom, frame, gravity):
    """Return whether any contact is that of the end of a cylinder on a flat face; see `find_corners`."""
    some = False
    for k in range(len(geom)):
        some = some or stand(shapes, geom[k], frame[k], gravity)[0] >= 0
    return some


@plain
def _rim(shapes, own, normal, toward, moves, gravity, flat):
    """Return the middle of the end of a cylinder on a face, and the direction to its lowest point, or where it tips."""
    (_, size, _, turn), center = shapes, row(shapes[2], own)
    axis = axis_of(turn, own, 2)
    side = np.copysign(1.0, dot(axis, normal))
    down = across(times(-1.0, normal), axis)
    if length(down) * size[own, 0] >= flat:
        to = unit(down)
    else:
        bodies, geom, motion = moves
        spin, velocity = relative_motion(bodies, geom, center)
        spin, velocity = plus(spin, 1.0, motion), plus(velocity, 1.0, motion[3:])
        spin, velocity = times(toward, spin), times(toward, velocity)
        to = _tip(normal, size[own], spin, velocity, gravity, axis_of(turn, own, 0))
    return plus(center, -side * size[own, 1], axis), unit(across(to, axis))


@plain
def _is_inside(shapes, base, normal, arm):
    """Return whether a point, seen from the middle of a geom, is above its face."""
    (kind, size, _, turn), inside = shapes, True
    if kind[base] == _CYLINDER:
        return length(across(arm, normal)) <= (1.0 + _SAME) * size[base, 0]
    for i in range(3 if kind[base] == _BOX else 0):
        axis = axis_of(turn, base, i)
        inside = inside and (abs(dot(axis, normal)) > 0.5 or abs(dot(axis, arm)) <= size[base, i])
    return inside


@plain
def _add(point, points, count):
    """Write a point as the place of a contact; return the number of contacts, one more."""
    points[count, 1], points[count, 2], points[count, 3] = point
    return count + 1


@plain
def _in_end(vector, axis, normal):
    """Return a vector moved along the normal of a face into the plane of an end with this axis."""
    return plus(vector, -dot(vector, axis) / dot(normal, axis), normal)


@plain
def _cut_box(shapes, base, normal, axis, middle, radius, points, count):
    """Add the points of an end above both ends of those edges of a face of a box, or of their parts, that are below it.

    ``middle`` is that of the rim, seen from the middle of the box.
    """
    (_, size, _, turn), face = shapes, face_along(shapes[3], base, normal)[0]
    for way in range(2):
        i, j = (face + 1 + way) % 3, (face + 2 - way) % 3
        along = _in_end(axis_of(turn, base, j), axis, normal)
        square = dot(along, along)
        for sign in (-1.0, 1.0):
            start = _in_end(minus(times(sign * size[base, i], axis_of(turn, base, i)), middle), axis, normal)
            at = -dot(start, along) / square
            room = at * at + (radius * radius - dot(start, start)) / square
            low, high = at - np.sqrt(max(room, 0.0)), at + np.sqrt(max(room, 0.0))
            if room <= 0.0 or low >= size[base, j] or high <= -size[base, j]:
                continue
            start = plus(start, 1.0, middle)
            if way == 0 or low > -size[base, j]:  # a corner of the face ends two edges
                count = _add(plus(start, max(low, -size[base, j]), along), points, count)
            if way == 0 or high < size[base, j]:
                count = _add(plus(start, min(high, size[base, j]), along), points, count)
    return count


@plain
def _cut_end(normal, axis, rim, middle, radius, to, points, count):
    """Add points of an end above that of another cylinder: where both rims cross, and corners of a square on the other.

    ``rim`` is the radius of the other end, m; ``middle`` is that of the upper rim, seen from the middle of that geom.
    """
    aside, beside, begun = unit(across(to, normal)), across(middle, normal), count
    for turn in range(4):
        corner = times(rim if turn < 2 else -rim, aside if turn % 2 == 0 else cross(normal, aside))
        if length(_in_end(minus(corner, middle), axis, normal)) < (1.0 - _SAME) * radius:
            count = _add(corner, points, count)
    far = length(beside)
    if abs(rim - radius) + _SAME * rim < far < rim + radius:
        at = 0.5 * (far + (rim - radius) * (rim + radius) / far)
        along, half = unit(beside), np.sqrt(max(rim * rim - at * at, 0.0))
        for sign in (-half, half):
            count = _add(plus(times(at, along), sign, cross(normal, along)), points, count)
    for k in range(begun, count):  # the rims are crossed as if they were parallel
        arm = _in_end(minus((points[k, 1], points[k, 2], points[k, 3]), middle), axis, normal)
        _add(plus(middle, min(1.0, radius / length(arm)), arm), points, k)
    return count


@plain
def _measure(normal, height, points):
    """Write the heights of points above a face, m; return the index of the lowest one."""
    lowest = 0
    for k in range(len(points)):
        points[k, 0] = dot(normal, points[k, 1:]) - height
        lowest = k if points[k, 0] < points[lowest, 0] else lowest
    return lowest


@plain
def _write_corners(shapes, upon, toward, reach, moves, gravity, flat, points):
    """Write the contacts of a cylinder on a face; return how many there are.

    ``upon`` is what `stand` returns; ``toward`` is 1.0 if the geom with the face is the first of the contact, else
    -1.0; ``moves`` are ``bodies``, and ``geom`` and ``motion`` of the contact, see `find_corners`.
    """
    (kind, size, place, turn), (own, base, normal) = shapes, upon
    (middle, to), axis = _rim(shapes, own, normal, toward, moves, gravity, flat), axis_of(turn, own, 2)
    center, radius, many, count = row(place, base), size[own, 0], 0, 0
    aside, middle = cross(axis, to), minus(middle, center)
    for turned in range(4):
        corner = plus(middle, radius if turned % 2 == 0 else -radius, to if turned < 2 else aside)
        if _is_inside(shapes, base, normal, corner):
            many = _add(corner, points, many)
    rest, height = many, 0.0
    if kind[base] == _BOX:
        face = face_along(turn, base, normal)[0]
        height, many = size[base, face], _cut_box(shapes, base, normal, axis, middle, radius, points, many)
    elif kind[base] == _CYLINDER:
        height, many = size[base, 1], _cut_end(normal, axis, size[base, 0], middle, radius, to, points, many)
    up = normal
    if _measure(normal, height, points[:many]) >= rest:  # an edge of the face touches the end
        up = times(np.copysign(1.0, dot(axis, normal)), axis)
    tangent = axis_of(turn, base, 0 if abs(dot(axis_of(turn, base, 0), normal)) < 0.5 else 1)
    for k in range(many):
        gap = points[k, 0] * dot(up, normal)
        if gap < reach or (count == 0 and k + 1 == many):
            point = plus(center, 1.0, (points[k, 1], points[k, 2], points[k, 3]))
            points[count, 0] = gap
            write_place(plus(point, -0.5 * gap, up), times(toward, up), unit(across(tangent, up)), points[count])
            count += 1
    return count


@plain
def find_corners(shapes, bodies, geom, reach, dist, pos, frame, motion, gravity, flat, owner, added):
    """Put contacts of cylinders that stand on flat faces at the corners of their ends, and list the others.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        bodies: see `relative_motion`.
        geom: geoms of contacts, (ncon, 2).
        reach: gaps from which contacts do not count, m, (ncon,).
        dist: gaps, m, (ncon,); written, like the next two.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        motion: angular velocity and velocity that surfaces have by themselves, the second relative to the first, rad/s
            and m/s, (ncon, 6).
        gravity: m/s^2, (3,).
        flat: height of the rim's highest point above the middle, m, up to which the whole rim is closed.
        owner: contacts of which copies are to be added, in ascending order, int64 (ROOM ncon,), written.
        added: gap, point and frame of each copy, (ROOM ncon, END), written; see `edge_on_face.END`.

    Returns:
        Whether any contact has changed, and the number of contacts to be added.
    """
    some, many, first = False, 0, 0
    for k in range(len(geom)):
        if geom[k, 0] != geom[first, 0] or geom[k, 1] != geom[first, 1]:
            first = k
        if k + 1 < len(geom) and geom[k + 1, 0] == geom[k, 0] and geom[k + 1, 1] == geom[k, 1]:
            continue
        upon = stand(shapes, geom[first], frame[first], gravity)
        if upon[0] < 0:
            continue
        moves, points, own = (bodies, geom[first], motion[first]), added[many:], k + 1 - first
        toward = 1.0 if upon[1] == geom[first, 0] else -1.0
        count = _write_corners(shapes, upon, toward, reach[first], moves, gravity, flat, points)
        if count == 0:
            continue
        some = True
        for i in range(own):
            dist[first + i] = OUT_OF_REACH
            if i < count:
                dist[first + i] = points[i, 0]
                put(pos[first + i], points[i, 1:4])
                put(frame[first + i], points[i, 4:])
        for i in range(own, count):
            owner[many] = k
            put(added[many], points[i])
            many += 1
    return some, many
