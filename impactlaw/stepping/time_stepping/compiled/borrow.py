"""A copy of the model's own structure for one step, with options and margins of its own: the user's stays as it is.

The copy shares all arrays but those of margins, so that many threads can step worlds of one model.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.stepping.time_stepping import borrowed
from impactlaw.stepping.time_stepping.compiled.fields import MODEL, SIZE, address_of, floats, ints, longs

_OFF, _ON = borrowed.OFF, borrowed.ON
_NO_DAMPING = borrowed.NO_DAMPING
_EULER, _RK4, _FAST = borrowed.EULER, borrowed.RK4, borrowed.FAST
_ELLIPTIC, _NEWTON = borrowed.ELLIPTIC, borrowed.NEWTON
_POLYNOMIAL = 2  # coefficients of each degree of freedom, MuJoCo's mjNPOLY


def room(model: mujoco.MjModel) -> int:
    """Return how many numbers of 64 bits a copy of a model takes beside its structure."""
    return model.nbody + 2 * model.ngeom + 2 * model.npair + model.njnt + model.ntendon


@compiled()
def borrow(user, model, margins, table, sticks):
    """Write the copy of a model for one step, and return the cone of the user's choice.

    Args:
        user: address of the model.
        model: address of its copy.
        margins: room for margins, (room,).
        table: offsets of fields.
        sticks: whether something sticks across gaps.
    """
    words = table[SIZE.model] // 8
    longs(model, words)[:] = longs(user, words)
    begin = 0
    for field, many in (
        (MODEL.body_margin, MODEL.nbody),
        (MODEL.geom_margin, MODEL.ngeom),
        (MODEL.pair_margin, MODEL.npair),
        (MODEL.jnt_margin, MODEL.njnt),
        (MODEL.tendon_margin, MODEL.ntendon),
        (MODEL.geom_gap, MODEL.ngeom),
        (MODEL.pair_gap, MODEL.npair),
    ):
        n = longs(user + table[many], 1)[0]
        margins[begin : begin + n] = 0.0
        if sticks:  # gaps count
            margins[begin : begin + n] = floats(longs(user + table[field], 1)[0], n)
        longs(model + table[field], 1)[0] = address_of(margins) + 8 * begin
        begin += n
    off, on = ints(model + table[MODEL.opt_disableflags], 1), ints(model + table[MODEL.opt_enableflags], 1)
    off[0] |= _OFF
    on[0] &= ~_ON
    cone = ints(model + table[MODEL.opt_cone], 1)
    chosen = cone[0]
    cone[0] = _ELLIPTIC
    ints(model + table[MODEL.opt_solver], 1)[0] = _NEWTON
    ints(model + table[MODEL.opt_noslip_iterations], 1)[0] = 0
    integrator = ints(model + table[MODEL.opt_integrator], 1)
    integrator[0] = _EULER if integrator[0] == _EULER or integrator[0] == _RK4 else _FAST
    return chosen


@compiled()
def is_damped(model, table):
    """Return whether the integrator of a copy of a model damps implicitly, by a mass matrix of its own."""
    if ints(model + table[MODEL.opt_integrator], 1)[0] != _EULER:
        return True
    if ints(model + table[MODEL.opt_disableflags], 1)[0] & _NO_DAMPING:
        return False
    nv, joints = longs(model + table[MODEL.nv], 1)[0], longs(model + table[MODEL.njnt], 1)[0]
    damping = floats(longs(model + table[MODEL.dof_damping], 1)[0], nv)
    more = floats(longs(model + table[MODEL.dof_dampingpoly], 1)[0], _POLYNOMIAL * nv)
    for i in range(nv):
        if damping[i] != 0.0:
            return True
    for i in range(_POLYNOMIAL * nv):
        if more[i] != 0.0:
            return True
    actuator = ints(longs(model + table[MODEL.jnt_actuatorid], 1)[0], joints)
    for i in range(joints):
        if actuator[i] != -1:
            return True
    return False


@compiled()
def limit_margins(model, table, reach):
    """Let no contact be found farther away than reach, m."""
    for field, many in (
        (MODEL.body_margin, MODEL.nbody),
        (MODEL.geom_margin, MODEL.ngeom),
        (MODEL.pair_margin, MODEL.npair),
    ):
        n = longs(model + table[many], 1)[0]
        margin = floats(longs(model + table[field], 1)[0], n)
        np.minimum(margin, reach, margin)
