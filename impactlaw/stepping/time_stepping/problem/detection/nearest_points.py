"""Nearest points that MuJoCo's contacts lack, and both ends of lines along which cylinders or boxes touch.

Of the corners that two faces share, MuJoCo keeps four which span a large area, and cylinders have corners, too. The
nearest point of two geoms may therefore be missing. It then replaces one of their contacts. So it does where MuJoCo
takes faces for parallel that are not quite so: it gives an edge beside the common part of these faces the normal of one
of them, which is wrong by up to 5 degrees. Cylinders and boxes that touch along a line get a contact at each of its
ends, see `scene.corrected.side_by_side` and `edge_on_face`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.corrected.side_by_side import END, find_ends, some_can_lie
from impactlaw.scene.tolerances import APART, PARALLEL
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain
from impactlaw.solvers.cones.algebra.vectors import across, cross, dot, minus, plus, row, unit, write
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, floats, ints, keep

_CAPSULE, _CYLINDER, _BOX, _MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("CAPSULE", "CYLINDER", "BOX", "MESH")
)
_CORNERS = 4  # largest number of corners of a face that MuJoCo keeps
_MISSED = 1e-6  # m: difference of gaps up to which the nearest point may be missing
_TURNED = 0.9998  # cosine of the angle to the normal of the nearest point from which that is used ...
_ASIDE = 2e-6  # m: ... if the nearest points are that far beside each other, seen along the other normal


@plain
def _can_miss(one, other, many, spread):
    """Return whether the nearest point of two shapes can be missing among MuJoCo's points of contact, or its normal.

    Even a single point can be wrong. Four points of one height are level corners.

    Args:
        one: type of a geom.
        other: type of the other geom.
        many: number of points of contact.
        spread: largest difference of their gaps, m.
    """
    if many == _CORNERS and spread <= _MISSED:
        return False
    known = one in (_CAPSULE, _CYLINDER, _BOX, _MESH) and other in (_CAPSULE, _CYLINDER, _BOX, _MESH)
    return known and (one in (_CYLINDER, _MESH) or other in (_CYLINDER, _MESH))


@plain
def _turn(frame, normal):
    """Give a frame, (9,), another normal."""
    tangent = unit(across(frame[3:], normal))
    write(normal, frame)
    write(tangent, frame[3:])
    write(cross(normal, tangent), frame[6:])


@plain
def _turn_others(first, end, nearest, normal, dist, frame):
    """Give the other contacts of faces that MuJoCo takes for parallel the normal of the nearest point."""
    for k in range(first, end):
        cosine = dot(frame[k], normal)
        if k != nearest and PARALLEL < cosine < _TURNED:
            dist[k] /= cosine
            _turn(frame[k], normal)


@plain
def _is_aside(first, end, gap, segment, frame):
    """Return whether the nearest points of two geoms are beside each other, seen along the normals of contacts."""
    for k in range(first, end):
        along = dot(minus(segment[3:], segment), frame[k])
        if 0.0 < along / gap < _TURNED and gap * gap - along * along > _ASIDE * _ASIDE:
            return True
    return False


@plain
def _replace(first, end, gap, segment, dist, pos, frame):
    """Move the contact that is closest to the nearest point of two geoms there.

    ``segment``, (6,), goes from the first to the second geom, ``gap``, m, is its length.
    """
    nearest, least = first, np.inf
    way = minus(segment[3:], segment)
    point = plus(segment, 0.5, way)
    for k in range(first, end):
        away = minus(point, row(pos, k))
        if dot(away, away) < least:
            nearest, least = k, dot(away, away)
    write(point, pos[nearest])
    dist[nearest] = along = dot(way, frame[nearest])
    if abs(gap) > _MISSED and 0.0 < along / gap < _TURNED:
        dist[nearest], normal = gap, (way[0] / gap, way[1] / gap, way[2] / gap)
        _turn(frame[nearest], normal)
        _turn_others(first, end, nearest, normal, dist, frame)


@kernel
def add_nearest(dist, pos, frame, geom, shape, margin, at):
    """Replace contacts of two geoms whose nearest point or its normal is missing; return whether any is missing.

    Args:
        dist: gaps, m, (ncon,); written, like the next two.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        geom: geoms of contacts, (ncon, 2).
        shape: MuJoCo's geom_type, (ngeom,).
        margin: geom_margin, (ngeom,); half of the sum of two is out of reach, see `margins.write_margins`.
        at: addresses of the model and of its data.
    """
    end, some, segment = 0, False, numbers(6)
    while end < len(dist):
        first, one, other = end, geom[end, 0], geom[end, 1]
        least, most = dist[first], dist[first]
        while end < len(dist) and geom[end, 0] == one and geom[end, 1] == other:
            least, most, end = min(least, dist[end]), max(most, dist[end]), end + 1
        if not _can_miss(shape[one], shape[other], end - first, most - least):
            continue
        reach = 0.5 * (margin[one] + margin[other])
        bound, found = min(least - _MISSED, reach), min(least + abs(least) + _MISSED, reach)
        gap = mj.geom_distance(at[0], at[1], one, other, max(found, APART), address_of(segment))
        if gap < bound or (gap < found and abs(gap) > _MISSED and _is_aside(first, end, gap, segment, frame)):
            some = True
            _replace(first, end, gap, segment, dist, pos, frame)
    keep(segment)
    return some


@plain
def _insert(dist, pos, frame, stride, first, many):
    """Insert contacts at first ends of lines before those at second ends.

    Contacts are moved as a whole, from the last one on: room for ``many`` more follows them. For the other arguments
    see `side_by_side.find_ends`; ``stride`` is the size of a contact, bytes.
    """
    begin, to = address_of(dist), len(dist) + many - 1
    whole, at = ints(begin, (to + 1, stride // 4)), ((address_of(pos) - begin) // 8, (address_of(frame) - begin) // 8)
    parts = floats(begin, (to + 1, stride // 8))
    for k in range(len(dist) - 1, -1, -1):
        if to == k:
            break
        for copy in range(1 if np.isnan(first[k, 0]) else 2):
            for i in range(stride // 4):
                whole[to, i] = whole[k, i]
            if copy == 1:
                parts[to, 0] = first[k, 0]
                for i in range(3):
                    parts[to, at[0] + i] = first[k, 1 + i]
                for i in range(9):
                    parts[to, at[1] + i] = first[k, 4 + i]
            to -= 1


@kernel
def add_ends(contacts, reach, shapes, at):
    """Give geoms that touch along a line a contact at each end of it; return whether anything was changed.

    Rows of constraints must be made again if so. Where MuJoCo has no room, which it counts, lines keep one contact.

    Args:
        contacts: gaps, points, frames and geoms of contacts, see `add_nearest`; written, and longer afterwards.
        reach: MuJoCo's includemargin, m, (ncon,).
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        at: addresses of the model and of its data.
    """
    dist, pos, frame, geom = contacts
    if not some_can_lie(shapes[0], geom):
        return False
    room, added = numbers(END * (len(reach) + 1)), 0
    first = room.reshape((len(reach) + 1, END))
    some = find_ends(shapes, geom, reach, dist, pos, frame, first)
    many = int(first[len(reach), 0])
    while added < many and mj.add_contact(at[0], at[1], address_of(dist)) == 0:
        added += 1
    _insert(dist, pos, frame, dist.strides[0], first, added)
    return some
