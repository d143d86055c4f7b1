"""MuJoCo's contacts, corrected: cylinders and capsules that touch along a line, as pipes in a pile and wheels at curbs.

The same for flat ends of cylinders on edges of boxes, which they touch along a chord, as pucks that tip over tables.

MuJoCo has one contact point for two cylinders, or a cylinder and a capsule. If their axes are parallel, all points of
the line along which they touch are equally near, and MuJoCo takes one of its ends. An impulse there tips bodies over.
They therefore get a contact at each end of the line. So do capsules, which have both in MuJoCo only if their axes are
parallel to some 1e-8. Both have the normal of the place where the axes are nearest. Their gaps are measured along it,
from the rim of the cylinder that ends there to the side of the other one, so that the smaller one is the distance of
the bodies. The more the axes cross, the shorter is the line; from an angle of `SIDE_BY_SIDE` on, cylinders touch in one
point if their sides cross, and otherwise have MuJoCo's contact, as capsules have.

MuJoCo's own distance, normal and point are not used, since some are wrong by a third of the bodies' size.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.corrected.edge_on_face import END, other_end, write_place
from impactlaw.scene.corrected.face_on_face import CORNERS, corners_of_faces
from impactlaw.scene.corrected.standing import stand
from impactlaw.scene.tolerances import CROSSED, CROSSES, SHORT_LINE, SIDE_BY_SIDE, SUNK_IN, THIN_LINE
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain, put
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, dot, minus, plus, row, times, unit

CYLINDER, CAPSULE, _BOX = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("CYLINDER", "CAPSULE", "BOX"))


@plain
def _is_long(kind, geom):
    return kind[geom] == CYLINDER or kind[geom] == CAPSULE


@plain
def _can_lie(kind, one, other):
    """Return whether two geoms are cylinders or capsules, or one of these and a box."""
    return one >= 0 and other >= 0 and _is_long(kind, one) and (_is_long(kind, other) or kind[other] == _BOX)


@plain
def _are_boxes(kind, one, other):
    return one >= 0 and other >= 0 and kind[one] == _BOX and kind[other] == _BOX


@plain
def some_can_lie(kind, geom):
    """Return whether any contacts, with geoms (ncon, 2), are those of geoms that can touch along a line."""
    some = False
    for k in range(len(geom)):
        one, other = geom[k, 0], geom[k, 1]
        some = some or _can_lie(kind, one, other) or _are_boxes(kind, one, other)
    return some


@plain
def _rod(shapes, geom):
    """Return a cylinder or a capsule: whether its ends are flat, radius and half length, m, centre, and axis."""
    kind, size, place, turn = shapes
    return kind[geom] == CYLINDER, size[geom, 0], size[geom, 1], row(place, geom), axis_of(turn, geom, 2)


@plain
def _edge(shapes, box, rod):
    """Return the edge of a box that is most parallel and nearest to a cylinder, as a cylinder without a radius."""
    (_, size, place, turn), (_, _, half, center, along), most = shapes, rod, 0
    between = minus(center, row(place, box))
    at = min(max(-dot(along, between), -half), half)
    for i in range(3):
        if abs(dot(axis_of(turn, box, i), along)) > abs(dot(axis_of(turn, box, most), along)):
            most = i
    middle = row(place, box)
    for i in range(3):
        out = axis_of(turn, box, i)
        side = np.sign(dot(out, plus(between, at, along)))
        middle = plus(middle, 0.0 if i == most else side * size[box, i], out)
    return True, 0.0, size[box, most], middle, axis_of(turn, box, most)


@plain
def _is_off_edge(shapes, box, edge, normal):
    """Return whether a normal from a cylinder to an edge of a box is not between those of the faces that meet there."""
    (_, _, place, turn), outside = shapes, False
    to = minus(edge[3], row(place, box))
    for i in range(3):
        out = axis_of(turn, box, i)
        outside = outside or (abs(dot(out, edge[4])) < 0.5 and dot(out, to) * dot(out, normal) >= 0.0)
    return outside


@plain
def _find_line(one, other):
    """Return first and last coordinate of a common line along the axis of one cylinder, m, and the normal of contact.

    The normal is that of the place where the axes are nearest; it is 0 if the cylinders do not touch with their sides.
    For cylinders, the axes of which must have about the same direction, see `_rod`.
    """
    (flat, radius, length, place, a), (also, thickness, span, center, b), none = one, other, (0.0, 0.0, 0.0)
    cosine, between = dot(a, b), minus(center, place)
    there, half, apart = dot(a, between), cosine * span, radius + thickness
    low, high = max(-length, there - half), min(length, there + half)
    shortest = THIN_LINE if flat and also else SHORT_LINE
    if cosine < CROSSES or high - low < shortest * apart:
        return 0.0, 0.0, none
    slant = minus((b[0] / cosine, b[1] / cosine, b[2] / cosine), a)
    square, start = dot(slant, slant), plus(between, -there / cosine, b)
    nearest = min(max(-dot(start, slant) / square, low), high) if square > 0.0 else 0.5 * (low + high)
    parallel = square <= SIDE_BY_SIDE**2
    as_found = not parallel and (nearest in (low, high) or thickness == 0.0 or not (flat or also))
    normal = plus(start, nearest, slant)
    if (nearest == low and there - half < low) or (nearest == high and there + half > high):  # the first one ends there
        normal = across(normal, b)
    distance = np.sqrt(dot(normal, normal))
    if distance < SUNK_IN * apart or apart - distance > high - low or as_found:
        return 0.0, 0.0, none
    normal = (normal[0] / distance, normal[1] / distance, normal[2] / distance)
    aside = across(slant, normal)
    crossing, far = np.sqrt(dot(aside, aside)), CROSSED * apart if parallel else 0.0
    if crossing * (high - low) > far:
        low, high = max(low, nearest - far / crossing), min(high, nearest + far / crossing)
    return low, high, normal


@plain
def _write_end(ends, touched, at, normal, toward, end):
    """Write gap, point and frame of a contact where the rim of one cylinder touches the side of another.

    Args:
        ends: cylinder that ends there, see `_rod`.
        touched: cylinder whose side is touched.
        at: coordinate of the end along the axis of ``ends``, m.
        normal: from the first geom of the contact to the second.
        toward: 1 if ``ends`` is the first geom of the contact, else -1.
        end: written, (END,).
    """
    (flat, radius, _, place, own), (_, thickness, _, center, along), rim = ends, touched, normal
    if flat:
        rim = unit(across(normal, own))
    point = plus(plus(place, at, own), toward * radius, rim)
    way, tilt = across(minus(center, point), along), dot(normal, along)
    end[0] = toward * dot(normal, way) - thickness * np.sqrt(1.0 - tilt * tilt)
    tangent = unit(plus(along, -tilt, normal))
    write_place(plus(point, 0.5 * toward * end[0], normal), normal, tangent, end)


@plain
def _supporting_edge(shapes, box, end):
    """Return the edge of a box on which the flat end of a cylinder lies, see `_edge`, and the normal out of the end.

    Of the edges that are nearest to the end, it is the one most parallel to it.
    """
    (_, size, place, turn), (_, _, _, center, axis), most = shapes, end, 0
    sign = np.sign(dot(axis, minus(row(place, box), center)))
    normal, middle = times(sign, axis), row(place, box)
    for i in range(3):
        if abs(dot(axis_of(turn, box, i), axis)) < abs(dot(axis_of(turn, box, most), axis)):
            most = i
    for i in range(3):
        out = axis_of(turn, box, i)
        middle = plus(middle, 0.0 if i == most else -np.sign(dot(out, normal)) * size[box, i], out)
    return middle, size[box, most], axis_of(turn, box, most), normal


@plain
def _write_chord(shapes, one, box, first, second):
    """Write the contacts at both ends of the chord along which the flat end of a cylinder touches an edge of a box.

    Return 0 if it does not, and otherwise 2. Where the end is beyond the whole box, their gaps are exact.
    """
    end = _rod(shapes, one)
    flat, radius, length, center, axis = end
    middle, half, along, normal = _supporting_edge(shapes, box, end)
    start, tilt = minus(middle, center), dot(along, normal)
    aside, level = across(start, axis), plus(along, -tilt, normal)
    square, part = dot(level, level), dot(aside, level)
    room = part * part - square * (dot(aside, aside) - radius * radius)
    if not flat or abs(tilt) > SIDE_BY_SIDE or room <= 0.0:
        return 0
    low, high = max((-part - np.sqrt(room)) / square, -half), min((-part + np.sqrt(room)) / square, half)
    gap = dot(start, normal) - length + min(low * tilt, high * tilt)
    inside = radius - np.sqrt(max(0.0, radius * radius - room / square))
    if high - low < SHORT_LINE * radius or gap < -inside:
        return 0
    for at, to in ((low, first), (high, second)):
        point = plus(middle, at, along)
        to[0] = dot(minus(point, center), normal) - length
        write_place(plus(point, -0.5 * to[0], normal), normal, unit(level), to)
    return 2


@plain
def _write_ends(shapes, one, other, single, first, second):
    """Write the contacts at both ends of the line along which two geoms touch.

    Return 0 if they do not, 1 if the line is a point, and otherwise 2. Flat ends that touch an edge of a box count if
    MuJoCo has a `single` contact there: it has several points where they lie on a face.
    """
    rod = _rod(shapes, one)
    beside = _rod(shapes, other) if shapes[0][other] != _BOX else _edge(shapes, other, rod)
    a, b = rod[4], beside[4]
    if dot(a, b) < 0.0:
        b = times(-1.0, b)
        beside = (beside[0], beside[1], beside[2], beside[3], b)
    low, high, normal = _find_line(rod, beside)
    off = shapes[0][other] == _BOX and _is_off_edge(shapes, other, beside, normal)
    if dot(normal, normal) == 0.0 or off:
        return _write_chord(shapes, one, other, first, second) if single and shapes[0][other] == _BOX else 0
    there, half = dot(a, minus(beside[3], rod[3])), dot(a, b) * beside[2]
    if low > there - half:
        _write_end(rod, beside, low, normal, 1.0, first)
    else:
        _write_end(beside, rod, -beside[2], normal, -1.0, first)
    if high < there + half:
        _write_end(rod, beside, high, normal, 1.0, second)
    else:
        _write_end(beside, rod, beside[2], normal, -1.0, second)
    return 1 if low == high else 2


@plain
def _write_both(shapes, geom, found, first, second):
    """Write MuJoCo's only contact of two boxes, and that at the other end of an edge on a face; return 0 or 2."""
    dist, pos, frame = found
    side = other_end(shapes, geom, dist, pos, frame, second)
    if side == 0.0:
        return 0
    if side < 0.0:
        put(first, second)
    own = first if side > 0.0 else second
    own[0] = dist
    put(own[1:4], pos)
    put(own[4:], frame)
    return 2


@kernel
def line_gap(shapes, one, other):
    """Return the gap of two geoms that touch along a line, m; minus infinity for others.

    MuJoCo's own distance is wrong by up to 3e-4 m where the gap is smaller than some 1e-8 m.
    """
    ends = numbers(2 * END)
    if not _can_lie(shapes[0], one, other) or _write_ends(shapes, one, other, True, ends[:END], ends[END:]) == 0:
        return -np.inf
    return min(ends[0], ends[END])


@plain
def _is_again(geom, k):
    """Return whether a contact is one more of the same geoms as the contact before it."""
    return 0 < k < len(geom) and geom[k, 0] == geom[k - 1, 0] and geom[k, 1] == geom[k - 1, 1]


@plain
def room(ncon):
    """Return how many contacts `find_ends` has room for: each may be one of `CORNERS`."""
    return (CORNERS - 1) * ncon + 1


@kernel
def find_ends(shapes, geom, reach, dist, pos, frame, owner, added):
    """Put contacts of geoms that touch along a line, or with faces of boxes, at one end or corner, and list the others.

    For boxes see `edge_on_face` and `face_on_face`. Capsules that are exactly parallel have both ends in MuJoCo. Where
    a side touches an edge of a box, MuJoCo may have found several contacts, which are put at both ends in turn.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        geom: geoms of contacts, (ncon, 2).
        reach: MuJoCo's includemargin, the gaps from which contacts do not count, m, (ncon,).
        dist: gaps, m, (ncon,); written, like the next four.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        owner: contacts of which copies are to be added, in ascending order, int64 (room(ncon),).
        added: gap, point and frame of each copy, (room(ncon), END). If a line is a point, or only one end is within
            reach, the contact is put there, and none is added.

    Returns:
        Whether any contact has moved, and the number of contacts to be added.
    """
    some, many, kind, turn, corners = False, 0, shapes[0], 0, numbers(6 * CORNERS).reshape((2, CORNERS, 3))
    for k in range(len(dist)):
        one, other, first, second = geom[k, 0], geom[k, 1], added[many], added[many + 1]
        turn = turn + 1 if _is_again(geom, k) else 0
        several = turn > 0 or _is_again(geom, k + 1)
        both = several and one >= 0 and other >= 0 and kind[one] == CAPSULE and kind[other] == CAPSULE
        ends = more = 0
        if stand(shapes, geom[k], frame[k], (0.0, 0.0, 0.0))[0] >= 0:
            continue
        if _can_lie(kind, one, other) and not both:
            ends = _write_ends(shapes, one, other, not several, first, second)
        elif _are_boxes(kind, one, other) and not several:
            more = corners_of_faces(shapes, geom[k], frame[k], reach[k], corners, added[many:]) - 1
            ends = 0 if more > 0 else _write_both(shapes, geom[k], (dist[k], pos[k], frame[k]), first, second)
        if ends == 0 and more < 1:
            continue
        some, chosen = True, second
        if ends > 0:
            two = ends == 2 and max(first[0], second[0]) < reach[k]
            more = 1 if two and not several else 0
            if (several and turn % 2 == 0) if two else first[0] < second[0]:
                chosen = first
        else:
            chosen = added[many + more]
        dist[k] = chosen[0]
        put(pos[k], chosen[1:4])
        put(frame[k], chosen[4:])
        owner[many : many + more] = k
        many += more
    return some, many
