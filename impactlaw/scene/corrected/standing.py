"""Contact points of cylinders that stand or rock on planes.

MuJoCo's points are the lowest one of the rim, and two more such that the three are corners of a triangle. They lack the
opposite one, on which a cylinder that rocks will land: others would be hit in its place, and too little energy lost.

Where the whole rim is closed, the lowest point consists of rounding errors. The three points hold a cylinder up to its
rim only in the direction of the first: with any other triangle, one that can stand would roll over the edge of the
triangle. In event-driven steps a square takes its place, with one corner where velocity and gravity tip the cylinder.
For time stepping see `stepping.time_stepping.compiled.detection.standing_cylinders`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.corrected.edge_on_face import write_place
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit, write

_PLANE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
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
    """Move the three contact points of a cylinder that stands on a plane to three corners of that square.

    Return the index of the first; -1 if there are not three.

    Args:
        pair: the plane and the cylinder.
        size: sizes of geoms, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9).
        geom: geoms of contacts, the plane first, (ncon, 2).
        pos: contact points, m, (ncon, 3); written: where the cylinder tips, and both points a quarter turn from there.
        motion: angular velocity of the cylinder and velocity of its center, relative to the plane, rad/s and m/s, (6,).
        gravity: m/s^2, (3,).
    """
    first, count = -1, 0
    for k in range(len(pos)):
        if geom[k, 0] == pair[0] and geom[k, 1] == pair[1]:
            first, count = k if count == 0 else first, count + 1
    if count != 3:
        return -1
    normal, center, radius = axis_of(turn, pair[0], 2), row(place, pair[1]), size[pair[1], 0]
    arm, to = minus(row(pos, first), center), _tip(normal, size[pair[1]], motion, gravity)
    if dot(to, to) == 0.0:
        to = unit(across(arm, normal))
    foot, aside = plus(center, dot(arm, normal), normal), cross(normal, to)
    write(plus(foot, radius, to), pos[first])
    write(plus(foot, radius, aside), pos[first + 1])
    write(plus(foot, -radius, aside), pos[first + 2])
    return first


@plain
def find_opposite(shapes, geom, reach, pos, frame, owner, added):
    """List contacts to be added where cylinders that rock on planes will land: opposite to their lowest points.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        geom: geoms of contacts, the plane first, (ncon, 2).
        reach: gaps from which contacts do not count, m, (ncon,).
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, (ncon, 9).
        owner: contacts of which copies are to be added, int64 (ncon,), written.
        added: gap, point and frame of each copy, (ncon, END), written; see `edge_on_face.END`.

    Returns:
        The number of contacts to be added.
    """
    (kind, size, place, turn), many, first = shapes, 0, 0
    for k in range(len(geom)):
        plane, own = geom[k, 0], geom[k, 1]
        if k > 0 and (geom[k - 1, 0] != plane or geom[k - 1, 1] != own):
            first = k
        last = k + 1 == len(geom) or geom[k + 1, 0] != plane or geom[k + 1, 1] != own
        if not last or k - first < 2 or plane < 0 or own < 0 or kind[plane] != _PLANE or kind[own] != _CYLINDER:
            continue
        axis, normal, center = axis_of(turn, own, 2), row(frame, first), row(place, own)
        arm = minus(row(pos, first), center)
        out = across(arm, axis)
        end = np.copysign(size[own, 1], dot(axis, arm))
        point = plus(plus(center, end, axis), -size[own, 0] / np.sqrt(dot(out, out)), out)
        gap = dot(minus(point, row(place, plane)), normal)
        if gap < reach[k]:
            owner[many], added[many, 0] = k, gap
            write_place(plus(point, -0.5 * gap, normal), normal, (frame[k, 3], frame[k, 4], frame[k, 5]), added[many])
            many += 1
    return many
