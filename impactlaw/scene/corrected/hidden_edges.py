"""Contacts with edges that a floor of several pieces hides: bodies slide on over them.

These functions run in Python; `stepping.compiled.left_out.hidden_edges` compiles them, too.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.tolerances import (
    APART,
    ASKEW,
    ASKEW_MEASURED,
    ASKEW_SPHERE,
    FLUSH,
    OUT_OF_REACH,
    PROBE,
    SUNK,
    SUNK_MEASURED,
    TOUCHING,
)

_FIELD, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("HFIELD", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)


def support(kind, size, normal):
    """Return how far a shape extends from its center along a normal in its frame, m; infinite if not in closed form."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    if kind == _SPHERE:
        return size[0]
    if kind == _CAPSULE:
        return size[0] + size[1] * z
    if kind == _ELLIPSOID:
        return np.sqrt((size[0] * x) ** 2 + (size[1] * y) ** 2 + (size[2] * z) ** 2)
    if kind == _CYLINDER:
        return size[0] * np.sqrt(x * x + y * y) + size[1] * z
    if kind == _BOX:
        return size[0] * x + size[1] * y + size[2] * z
    return np.inf


def beyond(g, point, normal, sign, shapes):
    """Return how far a geom extends beyond a point along a normal times `sign`, m."""
    shape, extent, place, turn = shapes
    far, own = 0.0, (0.0, 0.0, 0.0)
    for i in range(3):
        n = normal[i]
        far += sign * n * (place[g, i] - point[i])
        own = (own[0] + n * turn[g, 3 * i], own[1] + n * turn[g, 3 * i + 1], own[2] + n * turn[g, 3 * i + 2])
    return far + support(shape[g], extent[g], own)


def distance(at, one, other):
    """Return the distance of two geoms, m, or a larger one than `APART` if they are farther away."""
    return mujoco.mj_geomDistance(at[0], at[1], one, other, APART, None)


def moving_side(pair, body_of_geom, tree):
    """Return the place of the moving geom in a contact with a fixed one, -1 for other contacts."""
    if pair[0] < 0 or pair[1] < 0:
        return -1
    first, second = tree[body_of_geom[pair[0]]] >= 0, tree[body_of_geom[pair[1]]] >= 0
    return int(second) if first != second else -1


def hide_edges(dist, pos, frame, geom, body_of_geom, weld, tree, shapes, at, room):
    """Put contacts out of reach that the plane of a closed contact hides; return whether there are any.

    A body that slides over a floor of several pieces, such as the prisms of a height field, comes near the edge of the
    one ahead. That contact closes along the floor, but the body passes over it: no part of the geom ahead is above the
    floor, and no part of the body is lower than it has sunk into the floor. Where meshes and height fields are
    involved, the body is moved along the floor until that contact would close, and a little farther, to see whether it
    gets deeper. Contacts from above, as with a ceiling, are never hidden then.

    Args:
        dist: gaps, m, (ncon,); written.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, at least (ncon, 3).
        geom: geoms of contacts, (ncon, 2).
        body_of_geom: body of each geom, (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        tree: MuJoCo's body_treeid, -1 for bodies without degrees of freedom, (nbody,).
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
        at: the model and its data; in compiled code their addresses.
        room: scratch space, int (2 ngeom + ncon,).
    """
    ngeom, hidden = len(body_of_geom), False
    # the last contact of each moving geom with fixed ones, the deepest, and the one before each contact
    last, deepest, before = room[:ngeom], room[ngeom : 2 * ngeom], room[2 * ngeom :]
    last[:] = -1
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0:
            mover = geom[k, own]
            if last[mover] < 0 or dist[k] < dist[deepest[mover]]:
                deepest[mover] = k
            before[k], last[mover] = last[mover], k
    for s in range(len(dist)):
        own = -1 if dist[s] > TOUCHING else moving_side(geom[s], body_of_geom, tree)
        if own < 0:
            continue
        k = last[geom[s, own]]
        while k >= 0:
            if hides(s, k, own, s == deepest[geom[s, own]], dist, pos, frame, geom, (body_of_geom, weld), shapes, at):
                dist[k], hidden = OUT_OF_REACH, True
            k = before[k]
    return hidden


def hides(s, k, own, is_deepest, dist, pos, frame, geom, bodies, shapes, at):
    """Return whether contact s of a moving geom with the floor hides contact k of the same geom with the geom ahead."""
    mover, floor, up = geom[s, own], geom[s, 1 - own], 2.0 * own - 1.0
    ahead, sign = (geom[k, 1], -up) if geom[k, 0] == mover else (geom[k, 0], up)
    (body_of_geom, weld), (shape, _, place, _), along = bodies, shapes, 0.0
    if weld[body_of_geom[ahead]] != weld[body_of_geom[floor]] or (ahead == floor and shape[floor] != _FIELD):
        return False
    for i in range(3):
        along += sign * frame[k, i] * frame[s, i]
    sunk = max(0.0, -dist[s])
    if shape[mover] == _MESH or shape[ahead] == _MESH or shape[ahead] == _FIELD:
        if along > ASKEW_MEASURED or along < -ASKEW or not is_deepest:
            return False
        way = (PROBE + max(0.0, dist[k]) + 2.0 * SUNK_MEASURED * sunk) / (up * (1.0 - along * along))
        depth = depth_along(mover, ahead, way, sign, along, frame[k], frame[s], place, at)
        return depth <= FLUSH + SUNK_MEASURED * sunk
    if along > (ASKEW_SPHERE if shape[mover] == _SPHERE else ASKEW):
        return False
    if beyond(ahead, pos[s], frame[s], up, shapes) + 0.5 * dist[s] > FLUSH:
        return False
    return beyond(mover, pos[s], frame[s], -up, shapes) - 0.5 * dist[s] <= FLUSH + SUNK * sunk


def depth_along(mover, ahead, way, side, along, normal, floor, place, at):
    """Return how deep a geom overlaps the one ahead once it is moved into that contact along the floor, m.

    ``side`` is 1 if both normals, (3,), point to the geom or both from it, else -1; ``along`` is the cosine of the
    angle between those that point to it. ``way`` is negative if that of the floor points from it.
    """
    x, y, z = place[mover, 0], place[mover, 1], place[mover, 2]
    for i in range(3):
        place[mover, i] += way * (along * floor[i] - side * normal[i])
    depth = -distance(at, mover, ahead)
    place[mover, 0], place[mover, 1], place[mover, 2] = x, y, z
    return depth
