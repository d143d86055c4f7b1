"""Contact points of cylinders that stand on planes, turned about the axis to where the cylinders tip.

MuJoCo's points are the lowest one of the rim, and two more such that the three are corners of a triangle. Where the
whole rim is closed, the lowest point consists of rounding errors. The three points hold a cylinder up to its rim only
in the direction of the first: with any other triangle, one that can stand would roll over the edge of the triangle. The
triangle is therefore turned until its first corner is where velocity and gravity tip the cylinder.
"""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit, write

_SLOW = 1e-9  # m/s: speed up to which a velocity has no direction
_WEAK = 1e-9  # m/s^2: gravity along the plane up to which it has no direction


@plain
def _tip(normal, size, motion, gravity):
    """Return the direction in a plane in which a cylinder that stands on it tips, of length 1; 0 if there is none.

    The force that would stop the cylinder acts in this direction from its axis.
    """
    lever, square = size[1], 0.25 * size[0] ** 2 + size[1] ** 2 / 3.0
    way = plus(times(lever, motion[3:]), square, cross(motion, normal))
    way = across(way, normal)
    if dot(way, way) > (_SLOW * lever) ** 2:
        return unit(way)
    way = across(gravity, normal)
    return unit(way) if dot(way, way) > _WEAK**2 else (0.0, 0.0, 0.0)


@plain
def turn_standing(pair, size, place, turn, geom, pos, motion, gravity):
    """Turn the contact points of a cylinder that stands on a plane.

    Args:
        pair: the plane and the cylinder.
        size: sizes of geoms, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9).
        geom: geoms of contacts, the plane first, (ncon, 2).
        pos: contact points, m, (ncon, 3); written.
        motion: angular velocity of the cylinder and velocity of its center, relative to the plane, rad/s and m/s, (6,).
        gravity: m/s^2, (3,).
    """
    normal, center, known = axis_of(turn, pair[0], 2), row(place, pair[1]), False
    to, cosine, sine = _tip(normal, size[pair[1]], motion, gravity), 1.0, 0.0
    for k in range(len(pos)):
        if geom[k, 0] != pair[0] or geom[k, 1] != pair[1]:
            continue
        out = across(minus(row(pos, k), center), normal)
        aside = cross(normal, out)
        if not known:
            known, scale = True, 1.0 / np.sqrt(dot(out, out))
            cosine, sine = scale * dot(to, out), scale * dot(to, aside)
        if cosine != 0.0 or sine != 0.0:
            write(plus(plus(row(pos, k), cosine - 1.0, out), sine, aside), pos[k])
