"""MuJoCo's contacts, corrected: cylinders and capsules that touch along a line, side by side, as pipes in a pile.

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

from impactlaw.compiled import for_python
from impactlaw.scene.tolerances import CROSSED, CROSSES, SHORT_LINE, SIDE_BY_SIDE, SUNK_IN, THIN_LINE
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain

CYLINDER, CAPSULE = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
END = 13
"""Numbers of an end: its gap, m, its point, m, and its frame, as MuJoCo's."""


@plain
def _dot(v, w):
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@plain
def _plus(v, factor, w):
    return v[0] + factor * w[0], v[1] + factor * w[1], v[2] + factor * w[2]


@plain
def _unit(v):
    length = np.sqrt(_dot(v, v))
    return v[0] / length, v[1] / length, v[2] / length


@plain
def _axis(turn, geom, sign):
    return sign * turn[geom, 2], sign * turn[geom, 5], sign * turn[geom, 8]


@plain
def _place(place, geom):
    return place[geom, 0], place[geom, 1], place[geom, 2]


@plain
def _can_lie(kind, one, other):
    """Return whether two geoms are cylinders or capsules."""
    if one < 0 or other < 0:
        return False
    return (kind[one] == CYLINDER or kind[one] == CAPSULE) and (kind[other] == CYLINDER or kind[other] == CAPSULE)


@plain
def some_can_lie(kind, geom):
    """Return whether any contacts, with geoms (ncon, 2), are those of cylinders or capsules with each other."""
    some = False
    for k in range(len(geom)):
        some = some or _can_lie(kind, geom[k, 0], geom[k, 1])
    return some


@plain
def _find_line(shapes, one, other, sign):
    """Return first and last coordinate of a common line along the axis of one cylinder, m, and the normal of contact.

    The normal is that of the place where the axes are nearest; it is 0 if the cylinders do not touch with their sides.
    ``sign`` is -1 if the axes of both cylinders have opposite directions, else 1.
    """
    kind, size, place, turn = shapes
    a, b, none = _axis(turn, one, 1.0), _axis(turn, other, sign), (0.0, 0.0, 0.0)
    cosine, between = _dot(a, b), _plus(_place(place, other), -1.0, _place(place, one))
    there, half, apart = _dot(a, between), cosine * size[other, 1], size[one, 0] + size[other, 0]
    low, high = max(-size[one, 1], there - half), min(size[one, 1], there + half)
    shortest = THIN_LINE if kind[one] == CYLINDER and kind[other] == CYLINDER else SHORT_LINE
    if cosine < CROSSES or high - low < shortest * apart:
        return 0.0, 0.0, none
    slant = _plus((b[0] / cosine, b[1] / cosine, b[2] / cosine), -1.0, a)
    square, start = _dot(slant, slant), _plus(between, -there / cosine, b)
    nearest = min(max(-_dot(start, slant) / square, low), high) if square > 0.0 else 0.5 * (low + high)
    parallel = square <= SIDE_BY_SIDE**2
    as_found = not parallel and (nearest in (low, high) or (kind[one] == CAPSULE and kind[other] == CAPSULE))
    normal = _plus(start, nearest, slant)
    if (nearest == low and there - half < low) or (nearest == high and there + half > high):  # the first one ends there
        normal = _plus(normal, -_dot(normal, b), b)
    distance = np.sqrt(_dot(normal, normal))
    if distance < SUNK_IN * apart or apart - distance > high - low or as_found:
        return 0.0, 0.0, none
    normal = (normal[0] / distance, normal[1] / distance, normal[2] / distance)
    aside = _plus(slant, -_dot(slant, normal), normal)
    crossing, far = np.sqrt(_dot(aside, aside)), CROSSED * apart if parallel else 0.0
    if crossing * (high - low) > far:
        low, high = max(low, nearest - far / crossing), min(high, nearest + far / crossing)
    return low, high, normal


@plain
def _write_end(shapes, ends, touched, axes, at, normal, toward, end):
    """Write gap, point and frame of a contact where the rim of one cylinder touches the side of another.

    Args:
        shapes: see `find_ends`.
        ends: geom that ends there.
        touched: geom whose side is touched.
        axes: of both.
        at: coordinate of the end along the axis of ``ends``, m.
        normal: from the first geom of the contact to the second.
        toward: 1 if ``ends`` is the first geom of the contact, else -1.
        end: written, (END,).
    """
    (kind, size, place, _), (own, along), rim = shapes, axes, normal
    if kind[ends] == CYLINDER:
        rim = _unit(_plus(normal, -_dot(normal, own), own))
    point = _plus(_plus(_place(place, ends), at, own), toward * size[ends, 0], rim)
    way = _plus(_place(place, touched), -1.0, point)
    way, tilt = _plus(way, -_dot(way, along), along), _dot(normal, along)
    end[0] = toward * _dot(normal, way) - size[touched, 0] * np.sqrt(1.0 - tilt * tilt)
    tangent = _unit(_plus(along, -tilt, normal))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        end[1 + i] = point[i] + 0.5 * toward * end[0] * normal[i]
        end[4 + i], end[7 + i] = normal[i], tangent[i]
        end[10 + i] = normal[j] * tangent[k] - normal[k] * tangent[j]


@plain
def _write_ends(shapes, one, other, sign, line, first, second):
    """Write the contacts at both ends of a line; see `_find_line`, which returns it."""
    (_, size, place, turn), (low, high, normal) = shapes, line
    a, b = _axis(turn, one, 1.0), _axis(turn, other, sign)
    there, half = _dot(a, _plus(_place(place, other), -1.0, _place(place, one))), _dot(a, b) * size[other, 1]
    if low > there - half:
        _write_end(shapes, one, other, (a, b), low, normal, 1.0, first)
    else:
        _write_end(shapes, other, one, (b, a), -size[other, 1], normal, -1.0, first)
    if high < there + half:
        _write_end(shapes, one, other, (a, b), high, normal, 1.0, second)
    else:
        _write_end(shapes, other, one, (b, a), size[other, 1], normal, -1.0, second)


@plain
def _find_signed(shapes, one, other):
    """Return the result of `_find_line`, and the sign for which it is found."""
    turn = shapes[3]
    sign = 1.0 if _dot(_axis(turn, one, 1.0), _axis(turn, other, 1.0)) > 0.0 else -1.0
    return _find_line(shapes, one, other, sign), sign


@kernel
def line_gap(shapes, one, other):
    """Return the gap of two cylinders that touch along a line, m; minus infinity for other geoms.

    MuJoCo's own distance is wrong by up to 3e-4 m where the gap is smaller than some 1e-8 m.
    """
    if not _can_lie(shapes[0], one, other):
        return -np.inf
    (line, sign), ends = _find_signed(shapes, one, other), numbers(2 * END)
    if _dot(line[2], line[2]) == 0.0:
        return -np.inf
    _write_ends(shapes, one, other, sign, line, ends[:END], ends[END:])
    return min(ends[0], ends[END])


@plain
def _has_both(kind, geom, k):
    """Return whether MuJoCo has found both ends of the line of a contact, as for capsules that are exactly parallel."""
    for other in (k - 1, k + 1):
        if 0 <= other < len(geom) and geom[other, 0] == geom[k, 0] and geom[other, 1] == geom[k, 1]:
            return kind[geom[k, 0]] == CAPSULE and kind[geom[k, 1]] == CAPSULE
    return False


@plain
def find_ends(shapes, geom, reach, dist, pos, frame, first):
    """Put contacts of cylinders that touch with their sides at second ends of lines; return whether any moves.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        geom: geoms of contacts, (ncon, 2).
        reach: MuJoCo's includemargin, the gaps from which contacts do not count, m, (ncon,).
        dist: gaps, m, (ncon,); written, like the next three.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        first: contacts to be added at first ends, (ncon + 1, END), and their number in the last row; NaN for others.
            If the line is a point, or only one end is within reach, the contact is put there, and none is added.
    """
    some, many, kind = False, 0, shapes[0]
    for k in range(len(dist)):
        first[k, 0], one, other = np.nan, geom[k, 0], geom[k, 1]
        if not _can_lie(kind, one, other) or _has_both(kind, geom, k):
            continue
        (line, sign), second = _find_signed(shapes, one, other), first[len(dist)]
        if _dot(line[2], line[2]) == 0.0:
            continue
        _write_ends(shapes, one, other, sign, line, first[k], second)
        some, chosen, both = True, second, line[0] < line[1] and max(first[k, 0], second[0]) < reach[k]
        if not both and first[k, 0] < second[0]:
            chosen = first[k]
        dist[k] = chosen[0]
        for i in range(3):
            pos[k, i] = chosen[1 + i]
        for i in range(9):
            frame[k, i] = chosen[4 + i]
        many += both
        if not both:
            first[k, 0] = np.nan
    first[len(dist), 0] = many
    return some


find_ends_of_lines = for_python(find_ends)
"""The form of `find_ends` that Python calls."""
