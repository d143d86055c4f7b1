"""Points of contact of one face: all in one plane, so that a body can roll onto the face and stick at all of them.

MuJoCo puts a point of contact halfway between two surfaces. A foot whose corners are 1e-6 m apart in height then has
points of contact that are not in one plane, and closing their gaps by a rotation asks for tangential velocities
that differ by 1e-8 m/s: points that stick cannot have them, and push each other apart with all the friction there is.
"""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.scene.frames import make_orthogonal
from impactlaw.solvers.cones.algebra.loops import plain

_PARALLEL = 1e-9  # difference of normals of one face
_LEVEL = 1e-10  # m: points are in one plane that are as near to it
_CLOSED = 1e-4  # m: gaps up to which; of corners farther apart, a body meets one at a time


@plain
def _height(dist, pos, frame, k, near):
    """Return how far point `near` is above point k along the normal, m, if both can be in one plane, else infinity.

    They can if the normals are the same, and point k stays between its two surfaces.
    """
    height = 0.0
    for i in range(3):
        if abs(frame[near, i] - frame[k, i]) > _PARALLEL:
            return np.inf
        height += frame[k, i] * (pos[near, i] - pos[k, i])
    return height if abs(height) <= 0.5 * (abs(dist[k]) + abs(dist[near])) + _LEVEL else np.inf


@plain
def put_on_planes(dist, pos, frame, geom, body_of_geom):
    """Move points of contact of the same two bodies into the plane of the one with the least gap; return if any moves.

    Args:
        dist: gaps, m, (ncon,).
        pos: points of contact, m, (ncon, 3); written.
        frame: normals first, (ncon, 3) at least.
        geom: of contacts, (ncon, 2).
        body_of_geom: (ngeom,).
    """
    begin, end, moved = 0, 0, False
    for k in range(len(dist)):
        if k == end:
            begin = k
        one, other = body_of_geom[geom[k, 0]], body_of_geom[geom[k, 1]]
        while end < len(dist) and body_of_geom[geom[end, 0]] == one and body_of_geom[geom[end, 1]] == other:
            end += 1
        least, rise = abs(dist[k]), 0.0
        for j in range(begin, end if least <= _CLOSED else begin):
            if abs(dist[j]) < least:
                height = _height(dist, pos, frame, k, j)
                if height != np.inf:
                    least, rise = abs(dist[j]), height
        if abs(rise) > _LEVEL:
            moved = True
            for i in range(3):
                pos[k, i] += rise * frame[k, i]
    return moved


@compiled()
def mend_contacts(dist, pos, frame, geom, body_of_geom):
    """Do what `make_orthogonal` and `put_on_planes` do."""
    turned = make_orthogonal(frame)
    return put_on_planes(dist, pos, frame, geom, body_of_geom) or turned
