"""Friction rows of contacts for which those of MuJoCo are not right in a collision, in compiled code.

Their tangents are not orthogonal to the normal, see `scene.corrected.rounding`, or their points are in the middle of
the overlap with something that does not move, and not on the surface of the body.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.corrected.rounding import make_orthogonal
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import bodies_of, contact_floats, contact_ints, contacts_of
from impactlaw.stepping.compiled.fields import CONTACT, address_of, keep

TORSION = 3
"""Index of the torsion row; the rows are the normal, two of sliding, one of torsion, two of rolling."""


@plain
def shift_to_body(w, c):
    """Return how far contact c is put along its normal, m; see `collisions.Collisions.closed`."""
    (gap, _, _, geom), (body, _, tree) = contacts_of(w), bodies_of(w)
    still, other_still = tree[body[geom[c, 0]]] < 0, tree[body[geom[c, 1]]] < 0
    return 0.5 * gap[c] * (np.float64(still) - np.float64(other_still))


@kernel
def find_turning(w, c, turn):
    """Write the angular velocities of the only body with degrees of freedom at contact c per qvel, (3 nv,).

    Return 1 if that body is the second one, else -1.
    """
    geom, (body, _, tree) = contact_ints(w, CONTACT.geom, 2), bodies_of(w)
    side = 0 if tree[body[geom[c, 0]]] >= 0 else 1
    point = address_of(contact_floats(w, CONTACT.pos, 3)[c])
    mj.jac(w.model, w.data, np.int64(0), address_of(turn), point, body[geom[c, side]])
    return 2.0 * side - 1.0


@plain
def lengthen(w, c, d, lever, turn, col, row):
    """Add to a row of sliding what a shift of its point along the normal changes; see `find_turning`.

    ``lever`` is the shift, m, times the coefficient of friction, and times the sign that `find_turning` returns.
    """
    frame, axis, factor = contact_floats(w, CONTACT.frame, 9), 6 if d == 1 else 3, lever if d == 1 else -lever
    for a in range(len(col)):
        for i in range(3):
            row[a] += factor * frame[c, axis + i] * turn[i * w.nv + col[a]]


@kernel
def write_row(w, c, d, shift, mu, col, row):
    """Write a friction row, times its coefficient, along an axis of an orthogonal contact frame.

    Args:
        w: the world.
        c: the contact.
        d: index of the row in the contact.
        shift: how far the contact is put along its normal, m.
        mu: the coefficient of friction.
        col: degrees of freedom of the rows, (k,).
        row: the entries, (k,) or more, written.
    """
    frame, point, (body, _, tree) = numbers(9).reshape((1, 9)), numbers(3), bodies_of(w)
    put(frame[0], contact_floats(w, CONTACT.frame, 9)[c])
    for i in range(3):
        point[i] = contact_floats(w, CONTACT.pos, 3)[c, i] + shift * frame[0, i]
    make_orthogonal(frame)
    slides, null, moves = d < TORSION, np.int64(0), numbers(3 * w.nv)
    at, axis = address_of(moves), 3 * (d if slides else d - TORSION)
    row[: len(col)] = 0.0
    for side, sign in ((0, -mu), (1, mu)):
        part = body[contact_ints(w, CONTACT.geom, 2)[c, side]]
        if tree[part] < 0:
            continue
        mj.jac(w.model, w.data, at if slides else null, null if slides else at, address_of(point), part)
        for a in range(len(col)):
            for i in range(3):
                row[a] += sign * frame[0, axis + i] * moves[i * w.nv + col[a]]
    keep(point)
