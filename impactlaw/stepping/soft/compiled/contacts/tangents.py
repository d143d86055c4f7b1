"""Friction rows of contacts whose tangents in MuJoCo are not orthogonal to the normal, in compiled code.

See `scene.corrected.rounding`.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.corrected.rounding import make_orthogonal
from impactlaw.solvers.cones.algebra.loops import kernel, numbers
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_floats, contact_ints, model_ints, size
from impactlaw.stepping.compiled.fields import CONTACT, MODEL, address_of, keep

_TORSION = 3  # index of the torsion row; the rows are the normal, two of sliding, one of torsion, two of rolling


@kernel
def write_row(w, c, d, mu, col, row):
    """Write a friction row, times its coefficient, along an axis of an orthogonal contact frame.

    Args:
        w: the world.
        c: the contact.
        d: index of the row in the contact.
        mu: the coefficient of friction.
        col: degrees of freedom of the rows, (k,).
        row: the entries, (k,) or more, written.
    """
    frame, point, body = numbers(9).reshape((1, 9)), numbers(3), model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom))
    frame[0] = contact_floats(w, CONTACT.frame, 9)[c]
    point[:] = contact_floats(w, CONTACT.pos, 3)[c]
    make_orthogonal(frame)
    slides, null, moves = d < _TORSION, np.int64(0), numbers(3 * w.nv)
    at, axis = address_of(moves), 3 * (d if slides else d - _TORSION)
    row[: len(col)] = 0.0
    for side, sign in ((0, -mu), (1, mu)):
        part = body[contact_ints(w, CONTACT.geom, 2)[c, side]]
        mj.jac(w.model, w.data, at if slides else null, null if slides else at, address_of(point), part)
        for a in range(len(col)):
            for i in range(3):
                row[a] += sign * frame[0, axis + i] * moves[i * w.nv + col[a]]
    keep(point)
