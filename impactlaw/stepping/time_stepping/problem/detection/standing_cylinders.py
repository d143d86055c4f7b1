"""Contacts of cylinders that stand on planes, where MuJoCo's consist of rounding errors.

MuJoCo looks for the lowest point of the rim, and adds two points such that the three are corners of a triangle. If the
axis is the normal up to rounding, that point is arbitrary, its distance is wrong by up to the radius, and contacts may
be missing. Contacts are then found for the axis turned into the normal, and their gaps are measured at the true axis,
see `scene.corrected.rounding.measure_standing`.

The three points hold a cylinder up to its rim only in the direction of the first. It is therefore put to where
gravity and the velocity tip the cylinder: otherwise a cylinder that can stand would roll over the edge of the triangle.
"""

from __future__ import annotations

import mujoco

from impactlaw.scene.corrected.rounding import upright
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit
from impactlaw.stepping.time_stepping.problem.detection.carriers import carried_at

PLANE, CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_FLAT = 1e-7  # m: difference of heights around the rim of an upright cylinder
_SLOW = 1e-9  # m/s: speed up to which a velocity has no direction
_WEAK = 1e-9  # m/s^2: gravity along the plane up to which it has no direction


@plain
def _tip(plane, own, size, place, turn, motion):
    """Return the direction in a plane, of length 1, in which a cylinder that stands on it tends to tip.

    The force that would stop the cylinder acts in this direction from its axis.
    """
    velocity, subtree, root, body, gravity, mocap, position, surface = motion
    b, under = body[own], mocap[root[body[plane]]] if len(surface) > 0 else -1
    lever, square = size[own, 1], 0.25 * size[own, 0] ** 2 + size[own, 1] ** 2 / 3.0
    normal, center, spin = axis_of(turn, plane, 2), row(place, own), row(velocity, b)
    along = plus(velocity[b, 3:], 1.0, cross(spin, minus(center, row(subtree, root[b]))))
    if under >= 0:
        along = minus(along, carried_at(under, center, position, surface))
        spin = minus(spin, surface[under, 3:])
    way = across(plus(times(lever, along), square, cross(spin, normal)), normal)
    if not dot(way, way) > (_SLOW * lever) ** 2:
        way = across(gravity, normal)
        if not dot(way, way) > _WEAK**2:
            way = across(axis_of(turn, own, 0), normal)
    return unit(way)


@plain
def _is_near(plane, own, size, place, turn, margins):
    """Return whether the lower face is within the margins of contact."""
    geom_margin, pair_margin = margins
    height = dot(minus(row(place, own), row(place, plane)), axis_of(turn, plane, 2)) - size[own, 1]
    far = geom_margin[plane] + geom_margin[own]
    for i in range(len(pair_margin)):
        far = max(far, pair_margin[i])
    return height <= far


@plain
def make_upright(kind, size, place, turn, margins, motion, kept):
    """Turn cylinders near planes upright that are so up to rounding; return whether there are any.

    Args:
        kind: types of geoms, (ngeom,).
        size: their sizes, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9), written.
        margins: margins of geoms and of pairs, m.
        motion: MuJoCo's cvel, (nbody, 6), subtree_com, body_rootid and geom_bodyid, gravity, (3,), body_mocapid and
            mocap_pos, and velocities of mocap bodies, (nmocap, 6), or none if they do not move during a step.
        kept: the rotation matrices as they were, if any changes, (ngeom, 9), written.
    """
    some = False
    for plane in range(len(kind)):
        for own in range(len(kind) if kind[plane] == PLANE else 0):
            if kind[own] != CYLINDER:
                continue
            sign = upright(turn, plane, own, _FLAT / size[own, 0])
            if sign == 0.0 or not _is_near(plane, own, size, place, turn, margins):
                continue
            if not some:
                some = True
                for i in range(9 * len(kind)):
                    kept[i // 9, i % 9] = turn[i // 9, i % 9]
            to, normal = _tip(plane, own, size, place, turn, motion), times(sign, axis_of(turn, plane, 2))
            second = cross(normal, to)
            for i in range(3):
                turn[own, 3 * i], turn[own, 3 * i + 1], turn[own, 3 * i + 2] = to[i], second[i], normal[i]
    return some
