"""Nearest points that MuJoCo's contacts lack, and both ends of lines along which cylinders or boxes touch.

Of the corners that two faces share, MuJoCo keeps four which span a large area, and cylinders have corners, too. The
nearest point of two geoms may therefore be missing. It then replaces one of their contacts. So it does where MuJoCo
takes faces for parallel that are not quite so: it gives an edge beside the common part of these faces the normal of one
of them, which is wrong by up to 5 degrees. Cylinders and boxes that touch along a line get a contact at each of its
ends, see `scene.corrected.side_by_side` and `edge_on_face`; boxes that lie on each other one at each corner, see
`face_on_face`; and cylinders that stand or rock on flat faces the corners of their ends, see `standing`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.linked import linked
from impactlaw.scene.corrected.side_by_side import END, find_ends, room, some_can_lie
from impactlaw.scene.corrected.standing import ROOM, some_stand, stand
from impactlaw.scene.tolerances import APART, PARALLEL
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain
from impactlaw.solvers.cones.algebra.vectors import across, cross, dot, minus, plus, row, unit, write
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_floats, contacts_of, model_floats, shapes_of
from impactlaw.stepping.compiled.fields import CONTACT, MODEL, address_of, floats, ints, keep
from impactlaw.stepping.time_stepping.compiled.detection.standing_cylinders import (
    corners_of,
    gravity_of,
    leave_open_out,
)
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, WORLD
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting

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
def _add_nearest(w):
    """Replace contacts of two geoms whose nearest point or its normal is missing; return whether any is missing.

    Points are looked for within half of the margins of geoms, see `margins.write_margins`.
    """
    (dist, pos, frame, geom), shape = contacts_of(w), shapes_of(w)[0]
    margin = model_floats(w, MODEL.geom_margin, len(shape))
    end, some, segment = 0, False, numbers(6)
    while end < len(dist):
        first, one, other = end, geom[end, 0], geom[end, 1]
        least, most = dist[first], dist[first]
        while end < len(dist) and geom[end, 0] == one and geom[end, 1] == other:
            least, most, end = min(least, dist[end]), max(most, dist[end]), end + 1
        if not _can_miss(shape[one], shape[other], end - first, most - least):
            continue
        if stand(shapes_of(w), geom[first], frame[first], gravity_of(w))[0] >= 0:
            continue
        reach = 0.5 * (margin[one] + margin[other])
        bound, found = min(least - _MISSED, reach), min(least + abs(least) + _MISSED, reach)
        gap = mj.geom_distance(w.model, w.data, one, other, max(found, APART), address_of(segment))
        if gap < bound or (gap < found and abs(gap) > _MISSED and _is_aside(first, end, gap, segment, frame)):
            some = True
            _replace(first, end, gap, segment, dist, pos, frame)
    keep(segment)
    return some


@plain
def _insert(dist, pos, frame, owner, added, room):
    """Insert copies of contacts before these; where there is only room for some, the last ones.

    Contacts are moved as a whole, from the last one on. For the other arguments see `side_by_side.find_ends`.
    """
    begin, stride, a, to = address_of(dist), dist.strides[0], len(owner) - 1, len(dist) + room - 1
    whole, at = ints(begin, (to + 1, stride // 4)), ((address_of(pos) - begin) // 8, (address_of(frame) - begin) // 8)
    parts = floats(begin, (to + 1, stride // 8))
    for k in range(len(dist) - 1, -1, -1):
        if to == k:
            break
        copies = 0
        while copies <= a and owner[a - copies] == k:
            copies += 1
        for copy in range(min(copies, to - k) + 1):
            for i in range(stride // 4):
                whole[to, i] = whole[k, i]
            if copy > 0:
                parts[to, 0] = added[a, 0]
                for i in range(3):
                    parts[to, at[0] + i] = added[a, 1 + i]
                for i in range(9):
                    parts[to, at[1] + i] = added[a, 4 + i]
                a -= 1
            to -= 1


@kernel
def _add(w, owner, added):
    """Insert copies of contacts, see `_insert`. Where MuJoCo has no room, which it counts, some are missing."""
    (dist, pos, frame, _), space = contacts_of(w), 0
    while space < len(owner) and mj.add_contact(w.model, w.data, address_of(dist)) == 0:
        space += 1
    _insert(dist, pos, frame, owner, added, space)


@kernel
def _add_ends(w):
    """Give geoms that touch along a line or with faces a contact at each end or corner; return whether any was changed.

    The list of contacts is longer afterwards.
    """
    (dist, pos, frame, geom), shapes = contacts_of(w), shapes_of(w)
    if not some_can_lie(shapes[0], geom):
        return False
    reach, most = contact_floats(w, CONTACT.includemargin, 1)[:, 0], room(len(geom))
    owner, added = np.empty(most, np.int64), numbers(END * most).reshape((most, END))
    some, many = find_ends(shapes, geom, reach, dist, pos, frame, owner, added)
    _add(w, owner[:many], added)
    return some


@kernel
def _add_corners(w):
    """Give cylinders that stand or rock on flat faces the corners of their ends; return whether there are any."""
    _, _, frame, geom = contacts_of(w)
    if not some_stand(shapes_of(w), geom, frame, gravity_of(w)):
        return False
    most = ROOM * len(geom)
    owner, added = np.empty(most, np.int64), numbers(END * most).reshape((most, END))
    some, many = corners_of(w, owner, added)
    _add(w, owner[:many], added)
    leave_open_out(w)
    return some


@linked(BOOLEAN(WORLD))
def find_nearest(w):
    """Add points that MuJoCo's contacts lack, see above; return whether anything was changed.

    Rows of constraints must be made again if so.
    """
    some = _add_corners(w)
    some = _add_nearest(w) or some
    return (setting(w, SETTING.beside) != 0.0 and _add_ends(w)) or some
