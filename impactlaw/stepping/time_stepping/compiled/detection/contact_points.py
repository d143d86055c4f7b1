"""Move contact points onto the body that moves, and the points of one face into one plane.

MuJoCo puts a contact point halfway between two surfaces. Across a gap that the step closes, the lever of friction on a
ball is then longer than the radius by half the gap. If one of the two bodies has no degrees of freedom, such as a mocap
body, the point is put on the surface of the other body.

The contact points of a foot whose corners differ by 1e-6 m in height are not in one plane. Closing their gaps by a
rotation asks for tangential velocities that differ by 1e-8 m/s. Points that stick cannot have these velocities, and
push each other apart with all the available friction. Only with all points in one plane can a body roll onto the face
and stick at all of them.

Of the corners that two faces share, MuJoCo keeps four which span a large area, and cylinders have corners, too. The
nearest point of two geoms may therefore be missing. It then replaces one of their contacts (`nearest_points`).
"""

from __future__ import annotations

import numpy as np

from impactlaw.linked import linked
from impactlaw.scene.corrected.rounding import make_orthogonal, meet_axes
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import dot, minus, plus, row, write
from impactlaw.stepping.compiled.access import bodies_of, contact_ints, contacts_of, shapes_of
from impactlaw.stepping.compiled.fields import CONTACT
from impactlaw.stepping.compiled.left_out.hidden_edges import hide_edges
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, WORLD

_PARALLEL = 1e-9  # difference of normals up to which points belong to one face
_LEVEL = 1e-10  # m: distance up to which points are in one plane
_SEEN = 1e-6  # m: smaller gaps change the lever of a single point by a negligible amount
_CLOSED = 1e-4  # m: largest gap of points that are put into one plane; corners farther away touch down one at a time


@plain
def _are_between(geom, body_of_geom, weld, j, k):
    """Return whether two contacts are between the same two bodies; bodies that no joint separates count as one."""
    one, other = weld[body_of_geom[geom[k, 0]]], weld[body_of_geom[geom[k, 1]]]
    return weld[body_of_geom[geom[j, 0]]] == one and weld[body_of_geom[geom[j, 1]]] == other


@plain
def _is_of_face(dist, geom, body_of_geom, weld, k):
    """Return whether another contact between the same two bodies is nearly closed."""
    for step in (-1, 1):
        j = k + step
        while 0 <= j < len(dist) and _are_between(geom, body_of_geom, weld, j, k):
            if abs(dist[j]) <= _CLOSED:
                return True
            j += step
    return False


@plain
def put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree):
    """Move contact points with bodies without degrees of freedom onto the other body; return whether any moves.

    This concerns contacts with friction, except those of one face, which `put_on_planes` handles.

    Args:
        dist: gaps, m, (ncon,).
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).
        dim: MuJoCo's condim of contacts, (ncon,).
        geom: geoms of contacts, (ncon, 2).
        body_of_geom: body of each geom, (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        tree: MuJoCo's body_treeid, -1 for bodies without degrees of freedom, (nbody,).
    """
    moved = False
    for k in range(len(dist)):
        first, second = tree[body_of_geom[geom[k, 0]]] < 0, tree[body_of_geom[geom[k, 1]]] < 0
        if dim[k] == 1 or first == second or abs(dist[k]) <= _SEEN:
            continue
        if abs(dist[k]) > _CLOSED or not _is_of_face(dist, geom, body_of_geom, weld, k):
            moved = True
            write(plus(row(pos, k), (0.5 if first else -0.5) * dist[k], frame[k]), pos[k])
    return moved


@plain
def _height(dist, pos, frame, k, near):
    """Return the height of point `near` above point k along the normal, m; infinite if they cannot be in one plane.

    They can if the normals are equal, and point k stays between its two surfaces.
    """
    for i in range(3):
        if abs(frame[near, i] - frame[k, i]) > _PARALLEL:
            return np.inf
    height = dot(frame[k], minus(row(pos, near), row(pos, k)))
    return height if abs(height) <= 0.5 * (abs(dist[k]) + abs(dist[near])) + _LEVEL else np.inf


@plain
def put_on_planes(dist, pos, frame, geom, body_of_geom, weld):
    """Move contact points of two bodies into the plane of the point with the smallest gap; return whether any moves.

    For the arguments see `put_on_bodies`.
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
            write(plus(row(pos, k), rise, frame[k]), pos[k])
    return moved


@linked(BOOLEAN(WORLD))
def mend(w):
    """Correct the contacts of data; return whether anything was changed."""
    (dist, pos, frame, geom), (body_of_geom, weld, tree), shapes = contacts_of(w), bodies_of(w), shapes_of(w)
    dim, turned = contact_ints(w, CONTACT.dim, 1)[:, 0], make_orthogonal(frame)
    turned = meet_axes(*shapes, geom, pos, frame) or turned
    turned = hide_edges(dist, pos, frame, geom, body_of_geom, weld, tree, shapes, (w.model, w.data)) or turned
    moved = put_on_bodies(dist, pos, frame, dim, geom, body_of_geom, weld, tree)
    return put_on_planes(dist, pos, frame, geom, body_of_geom, weld) or moved or turned
