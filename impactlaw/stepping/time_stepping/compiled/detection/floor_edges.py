"""Leave contacts with the edges of a floor of several pieces out at first, which bodies may pass over.

A body that slides or rolls over such a floor, as over the prisms of a height field, comes near the edge of the piece
ahead. That gap closes along its gradient, but the body passes over the edge. An open contact of a body with a fixed one
is therefore doubtful where the body has a nearer contact with fixed bodies in another direction. Whether it closes is
measured, see `passed_edges`.
"""

from __future__ import annotations

from impactlaw.scene.tolerances import TOUCHING
from impactlaw.solvers.cones.algebra.loops import kernel, unset
from impactlaw.solvers.cones.algebra.vectors import dot
from impactlaw.stepping.compiled.access import bodies_of, contact_ints, contacts_of
from impactlaw.stepping.compiled.fields import CONTACT
from impactlaw.stepping.compiled.left_out.hidden_edges import moving_side
from impactlaw.stepping.time_stepping.compiled.detection.fast_bodies import can_pass

_SAME = 1.0 - 1e-6
"""Cosine of the angle between two normals from which they are one direction."""


@kernel
def leave_edges(w, chosen, doubtful):
    """Leave contacts with edges of fixed bodies out that bodies may pass over; return whether there are any.

    These are open contacts of a body with a fixed one, if it has a nearer one in another direction. Of two that are
    equally near, as of a ball that falls into the middle of a groove, both take part. For the arguments see
    `fast_bodies.leave_fast`.
    """
    (dist, _, frame, geom), (body_of_geom, weld, tree), some = contacts_of(w), bodies_of(w), False
    address = contact_ints(w, CONTACT.efc_address, 1)[:, 0]
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0 and address[k] >= 0 and chosen[address[k]]:
            doubtful[k] = dist[k] > TOUCHING and can_pass(w, geom[k])
            some = some or doubtful[k]
    if not some:
        return False
    nearest, some = unset(len(weld)), False
    for k in range(len(dist)):
        own = moving_side(geom[k], body_of_geom, tree)
        if own >= 0 and address[k] >= 0 and chosen[address[k]]:
            body = weld[body_of_geom[geom[k, own]]]
            if nearest[body] < 0 or dist[k] < dist[nearest[body]]:
                nearest[body] = k
    for k in range(len(dist)):
        if not doubtful[k] or not chosen[address[k]]:
            continue
        own = moving_side(geom[k], body_of_geom, tree)
        s = nearest[weld[body_of_geom[geom[k, own]]]]
        along = dot(frame[k], frame[s])
        if own != moving_side(geom[s], body_of_geom, tree):
            along = -along
        doubtful[k] = along < _SAME and dist[k] > dist[s] + TOUCHING
        if doubtful[k]:
            chosen[address[k]], some = False, True
    return some
