"""Leave contacts out that a body passes, although their gradients say that they close.

Some open contacts are doubtful, and left out at first, see `fast_bodies` and `floor_edges`. If the resulting velocity
v+ closes them, the gap is measured where it leads, at ``q_M ⊕ h v+``, where the next step looks for contacts, and on
the way there. Only contacts of bodies that overlap there take part.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones.algebra.loops import cleared, kernel, plain, put
from impactlaw.solvers.cones.algebra.vectors import dot, minus
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import bodies_of, contact_ints, contacts_of, offset, velocity_of
from impactlaw.stepping.compiled.fields import CONTACT, DATA, address_of, floats, long_at
from impactlaw.stepping.compiled.left_out.hidden_edges import moving_side
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carried, carrier_of, carry_on
from impactlaw.stepping.time_stepping.compiled.detection.fast_bodies import thickness
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW

_PASSED = 3e-6
"""Overlap, m, up to which a body passes over an edge."""
_LOOKS = 8
"""Largest number of places where a gap is measured."""


@plain
def _is_asked(w, k, chosen, seen, doubtful):
    """Return whether it is asked if a contact closes."""
    row = contact_ints(w, CONTACT.efc_address, 1)[k, 0]
    return doubtful[k] and seen[row] and not chosen[row]


@plain
def _rate(w, k, jacobian):
    """Return how fast a contact opens along its gradient, m/s."""
    (_, point, frame, geom), (nnz, adr, col, J), along = contacts_of(w), jacobian, 0.0
    row, velocity = contact_ints(w, CONTACT.efc_address, 1)[k, 0], velocity_of(w)
    for a in range(adr[row], adr[row] + nnz[row]):
        along += J[a] * velocity[col[a]]
    one = carried(w, carrier_of(w, geom[k, 0]), point[k], ROW.now)
    other = carried(w, carrier_of(w, geom[k, 1]), point[k], ROW.now)
    return along + dot(frame[k], minus(other, one))


@plain
def _place(w, middle, time):
    """Move other data to where velocities lead within some time."""
    qpos = floats(long_at(w.scratch + offset(w, DATA.qpos)), len(middle))
    put(qpos, middle)
    carry_on(w, time)
    mj.integrate_pos(w.model, address_of(qpos), address_of(velocity_of(w)), time)
    mj.kinematics(w.model, w.scratch)


@kernel
def pass_over(w, jacobian, middle, chosen, seen, doubtful):
    """Take contacts out of those that the velocity of data closes, v+, if bodies pass them.

    Gaps are measured at least once while the body, or two that move, enter by half their thickness. Bodies that would
    enter by more than `_LOOKS` allow count as bodies that do not pass.

    Args:
        w: the world; its other data is changed.
        jacobian: `access.jacobian_of`.
        middle: q_M, (nq,).
        chosen: MuJoCo's rows that take part already, bool (nefc,).
        seen: rows that the velocity closes, bool (nefc,); written.
        doubtful: see `fast_bodies.leave_fast`.
    """
    (dist, _, _, geom), (body_of_geom, _, tree) = contacts_of(w), bodies_of(w)
    hit, looks, many, address = cleared(len(dist)), 2, 0, contact_ints(w, CONTACT.efc_address, 1)
    for k in range(len(dist)):
        if _is_asked(w, k, chosen, seen, doubtful):
            own, thin = moving_side(geom[k], body_of_geom, tree), 0.0
            for i in range(2):
                if own < 0 or i == own:
                    thin += thickness(w, geom[k, i])
            parts = np.ceil((-dist[k] - w.timestep * _rate(w, k, jacobian)) / thin)
            hit[k] = 2.0 * parts > _LOOKS
            if not hit[k]:
                many, looks = many + 1, max(looks, 2 * int(parts))
    for i in range(looks, 0, -1):
        if many > 0:
            _place(w, middle, i / looks * w.timestep)
            many = _hits(w, chosen, seen, doubtful, hit)
    for k in range(len(dist)):
        if _is_asked(w, k, chosen, seen, doubtful) and not hit[k]:
            seen[address[k, 0]] = False


@plain
def _hits(w, chosen, seen, doubtful, hit):
    """Mark contacts whose bodies overlap in other data; return how many are not marked."""
    many, end, gap, geom = 0, 0, 0.0, contact_ints(w, CONTACT.geom, 2)
    while end < len(geom):
        first, asked = end, False
        while end < len(geom) and geom[end, 0] == geom[first, 0] and geom[end, 1] == geom[first, 1]:
            asked = asked or (not hit[end] and _is_asked(w, end, chosen, seen, doubtful))
            end += 1
        if asked:
            gap = mj.geom_distance(w.model, w.scratch, geom[first, 0], geom[first, 1], APART, 0)
        for k in range(first, end if asked else first):
            if _is_asked(w, k, chosen, seen, doubtful):
                hit[k] = hit[k] or gap < -_PASSED
                many += not hit[k]
    return many
