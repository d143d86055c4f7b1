"""Points of contact: on the body that moves, and those of one face in one plane.

MuJoCo puts a point of contact halfway between two surfaces. Across a gap that the step closes, friction then has a
lever that is longer than a ball's radius by half the gap. Where one of two bodies has no degrees of freedom, as mocap
bodies have none, the point is put on the surface of the other one.

A foot whose corners are 1e-6 m apart in height has points of contact that are not in one plane, and closing their gaps
by a rotation asks for tangential velocities that differ by 1e-8 m/s: points that stick cannot have them, and push each
other apart with all the friction there is. So a body can roll onto the face and stick at all of them only if they are
in one plane.
"""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.scene.frames import make_orthogonal
from impactlaw.solvers.cones.algebra.loops import plain

_PARALLEL = 1e-9  # difference of normals of one face
_LEVEL = 1e-10  # m: points are in one plane that are as near to it
_SEEN = 1e-6  # m: smaller gaps change the lever of a single point by less than matters
_CLOSED = 1e-4  # m: gaps up to which points are put into one plane; corners farther away meet one at a time


@plain
def _are_between(geom, body_of_geom, weld, j, k):
    """Return whether two contacts are between the same two bodies; those that no joint separates are one."""
    one, other = weld[body_of_geom[geom[k, 0]]], weld[body_of_geom[geom[k, 1]]]
    return weld[body_of_geom[geom[j, 0]]] == one and weld[body_of_geom[geom[j, 1]]] == other


@plain
def _is_of_face(dist, geom, body_of_geom, weld, k):
    """Return whether some other contact between the same two bodies is as good as closed."""
    for step in (-1, 1):
        j = k + step
        while 0 <= j < len(dist) and _are_between(geom, body_of_geom, weld, j, k):
            if abs(dist[j]) <= _CLOSED:
                return True
            j += step
    return False


@plain
def put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree):
    """Move points of contact with what has no degrees of freedom onto the other body; return if any moves.

    It is done for contacts with friction, but for those of one face that `put_on_planes` takes.

    Args:
        dist: gaps, m, (ncon,).
        pos: points of contact, m, (ncon, 3); written.
        frame: normals first, (ncon, 3) at least.
        dim: MuJoCo's condim of contacts, (ncon,).
        geom: of contacts, (ncon, 2).
        body_of_geom: (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        tree: MuJoCo's body_treeid, -1 for what has no degrees of freedom, (nbody,).
    """
    moved = False
    for k in range(len(dist)):
        first, second = tree[body_of_geom[geom[k, 0]]] < 0, tree[body_of_geom[geom[k, 1]]] < 0
        if dim[k] == 1 or first == second or abs(dist[k]) <= _SEEN:
            continue
        if abs(dist[k]) > _CLOSED or not _is_of_face(dist, geom, body_of_geom, weld, k):
            moved = True
            for i in range(3):
                pos[k, i] += (0.5 if first else -0.5) * dist[k] * frame[k, i]
    return moved


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
def put_on_planes(dist, pos, frame, geom, body_of_geom, weld):
    """Move points of contact of the same two bodies into the plane of the one with the least gap; return if any moves.

    Args:
        dist: gaps, m, (ncon,).
        pos: points of contact, m, (ncon, 3); written.
        frame: normals first, (ncon, 3) at least.
        geom: of contacts, (ncon, 2).
        body_of_geom: (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
    """
    begin, end, moved = 0, 0, False
    for k in range(len(dist)):
        if k == end:
            begin = k
        while end < len(dist) and _are_between(geom, body_of_geom, weld, end, k):
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
def mend_contacts(dist, pos, frame, dim, geom, body_of_geom, weld, tree):
    """Do what `make_orthogonal`, `put_on_bodies` and `put_on_planes` do."""
    turned = make_orthogonal(frame)
    moved = put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree)
    return put_on_planes(dist, pos, frame, geom, body_of_geom, weld) or moved or turned
