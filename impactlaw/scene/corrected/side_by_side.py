"""MuJoCo's contacts, corrected: cylinders that touch along a line, side by side, such as two pucks on a table.

MuJoCo has one contact point for two cylinders, or a cylinder and a capsule. If their axes are parallel, all points of
the line along which they touch are equally near, and MuJoCo takes one of its ends. An impulse there would tip pucks
over. The point is therefore put where an impulse along the normal leaves the bodies parallel: both then turn alike
about the third direction, and the restitution is that of the law on the whole line. With centers of mass c_1 and c_2
along the axis, and inverse moments of inertia a_1 and a_2, this is ``(a_1 c_1 + a_2 c_2) / (a_1 + a_2)``.
"""

from __future__ import annotations

import mujoco

from impactlaw.compiled import for_python
from impactlaw.scene.tolerances import SIDE, SIDE_BY_SIDE
from impactlaw.solvers.cones.algebra.loops import plain

_CYLINDER, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)


@plain
def _are_long(kind, one, other):
    """Return whether two geoms are cylinders, or a cylinder and a capsule."""
    if one < 0 or other < 0 or (kind[one] != _CYLINDER and kind[other] != _CYLINDER):
        return False
    return (kind[one] in (_CYLINDER, _CAPSULE)) and (kind[other] in (_CYLINDER, _CAPSULE))


@plain
def _is_single(geom, k):
    """Return whether contact k is the only one between its geoms, whose contacts follow each other."""
    for j in (k - 1, k + 1):
        if 0 <= j < len(geom) and geom[j, 0] == geom[k, 0] and geom[j, 1] == geom[k, 1]:
            return False
    return True


@plain
def put_between(shapes, inverse, center, body_of_geom, weld, geom, pos, frame):
    """Put the contact points of parallel cylinders where an impulse leaves them parallel, or as near to that as can be.

    Args:
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        inverse: MuJoCo's body_invweight0, whose second column has inverse moments of inertia, (nbody, 2).
        center: MuJoCo's subtree_com, m, (nbody, 3).
        body_of_geom: body of each geom, (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        geom: geoms of contacts, (ncon, 2).
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).

    Returns:
        Whether any point moves.
    """
    (kind, size, place, turn), moved = shapes, False
    for k in range(len(geom)):
        one, other = geom[k, 0], geom[k, 1]
        if not _are_long(kind, one, other) or not _is_single(geom, k):
            continue
        first, second = weld[body_of_geom[one]], weld[body_of_geom[other]]
        cosine, normal, there, here, tilt, c_1, c_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            axis = turn[one, 3 * i + 2]
            cosine += axis * turn[other, 3 * i + 2]
            normal += axis * frame[k, i]
            there += axis * (place[other, i] - place[one, i])
            here += axis * (pos[k, i] - place[one, i])
            c_1 += axis * (center[first, i] - place[one, i])
            c_2 += axis * (center[second, i] - place[one, i])
        for i in range(3):
            tilt += (turn[other, 3 * i + 2] - cosine * turn[one, 3 * i + 2]) ** 2
        low = max(-size[one, 1], there - size[other, 1])
        high = min(size[one, 1], there + size[other, 1])
        if tilt > SIDE_BY_SIDE**2 or abs(normal) > SIDE or low >= high:
            continue
        moved, a_1, a_2, best = True, inverse[first, 1], inverse[second, 1], 0.5 * (low + high)
        if a_1 + a_2 > 0.0:
            best = min(max((a_1 * c_1 + a_2 * c_2) / (a_1 + a_2), low), high)
        for i in range(3):
            pos[k, i] += (best - here) * turn[one, 3 * i + 2]
    return moved


put_in_between = for_python(put_between)
"""The form of `put_between` that Python calls."""
