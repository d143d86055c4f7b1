"""Copy the model's structure for one step with its own options and margins; the user's model stays unchanged.

The copy shares all arrays except margins and ranges of tendons, so that many threads can step worlds of one model.

Cones are elliptic, and no body sleeps. MuJoCo's gaps count only if bodies stick across them. RK4 becomes Euler, and the
implicit integrators become implicitfast, whose mass matrix is symmetric.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial
from itertools import repeat
from typing import Any

import mujoco
import numpy as np

from impactlaw.scene.tolerances import NEVER
from impactlaw.solvers.cones.algebra.loops import plain, put
from impactlaw.stepping.compiled import layout
from impactlaw.stepping.compiled.access import model_floats, size
from impactlaw.stepping.compiled.fields import (
    MODEL,
    SIZE,
    address_of,
    floats,
    int_at,
    ints,
    long_at,
    longs,
    put_int,
    put_long,
)

_EULER, _RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
_FAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_OFF = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET) | int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
_ON = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE) | int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_ELLIPTIC, _NEWTON = int(mujoco.mjtCone.mjCONE_ELLIPTIC), int(mujoco.mjtSolver.mjSOL_NEWTON)
_NO_DAMPING = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
_WRAP_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_POLYNOMIAL = 2  # number of coefficients of each degree of freedom, MuJoCo's mjNPOLY


def room(model: mujoco.MjModel) -> int:
    """Return the number of 64-bit numbers that a copy of a model needs in addition to its structure."""
    return model.nbody + 2 * model.ngeom + 2 * model.npair + model.njnt + 3 * model.ntendon


_MARGINS = (
    (MODEL.body_margin, MODEL.nbody), (MODEL.geom_margin, MODEL.ngeom), (MODEL.pair_margin, MODEL.npair),
    (MODEL.jnt_margin, MODEL.njnt), (MODEL.tendon_margin, MODEL.ntendon), (MODEL.geom_gap, MODEL.ngeom),
    (MODEL.pair_gap, MODEL.npair),
)  # fmt: skip
"""Margins and gaps that a step changes, and their numbers."""
_ARRAYS = (*(field for field, _ in _MARGINS), MODEL.tendon_range)
_OPTIONS = (
    MODEL.opt_disableflags, MODEL.opt_enableflags, MODEL.opt_cone, MODEL.opt_solver, MODEL.opt_noslip_iterations,
    MODEL.opt_integrator,
)  # fmt: skip


def changed_in_place(model: Any) -> Callable[[], object]:
    """Return what restores the user's own model after `copy_model` has written into it.

    It does so within C code, since Python code might be interrupted.
    """
    kinds: Any = (ctypes.c_void_p, _ARRAYS), (ctypes.c_int, _OPTIONS)
    table = layout.table()
    places = [kind.from_address(model._address + int(table[field])) for kind, fields in kinds for field in fields]
    return partial(list, map(setattr, places, repeat("value"), [place.value for place in places]))


@plain
def _at(table, place):
    return long_at(table + 8 * place)


@plain
def copy_model(user, model, margins, table, sticks):
    """Write the copy of a model for one step, and return the kind of friction cone that the user has chosen.

    Args:
        user: address of the model.
        model: address of its copy, or of the model itself, see `changed_in_place`.
        margins: room for margins and for ranges of tendons, (room,).
        table: address of offsets of fields.
        sticks: whether bodies can stick across gaps.
    """
    words = _at(table, SIZE.model) // 8
    put(longs(model, words), longs(user, words))
    begin = 0
    for field, many in _MARGINS:
        n = long_at(user + _at(table, many))
        margins[begin : begin + n] = 0.0
        if sticks:  # gaps count
            put(margins[begin : begin + n], floats(long_at(user + _at(table, field)), n))
        put_long(model + _at(table, field), address_of(margins) + 8 * begin)
        begin += n
    _copy_ranges(user, model, margins, begin, table)
    off, on = model + _at(table, MODEL.opt_disableflags), model + _at(table, MODEL.opt_enableflags)
    put_int(off, np.int32(int_at(off) | _OFF))
    put_int(on, np.int32(int_at(on) & ~_ON))
    cone = model + _at(table, MODEL.opt_cone)
    chosen = int_at(cone)
    put_int(cone, np.int32(_ELLIPTIC))
    put_int(model + _at(table, MODEL.opt_solver), np.int32(_NEWTON))
    put_int(model + _at(table, MODEL.opt_noslip_iterations), np.int32(0))
    integrator = model + _at(table, MODEL.opt_integrator)
    kind = int_at(integrator)
    put_int(integrator, np.int32(_EULER if kind == _EULER or kind == _RK4 else _FAST))
    return chosen


@plain
def _copy_ranges(user, model, room, begin, table):
    """Write ranges of tendons; those of `scene.joint_limits.slack_ropes` never reach their lower limit."""
    n = long_at(user + _at(table, MODEL.ntendon))
    ranges = room[begin : begin + 2 * n]
    put(ranges, floats(long_at(user + _at(table, MODEL.tendon_range)), 2 * n))
    first, kind = long_at(user + _at(table, MODEL.tendon_adr)), long_at(user + _at(table, MODEL.wrap_type))
    for i in range(n):
        if ranges[2 * i] <= 0.0 and int_at(kind + 4 * int_at(first + 4 * i)) != _WRAP_JOINT:
            ranges[2 * i] = NEVER
    put_long(model + _at(table, MODEL.tendon_range), address_of(room) + 8 * begin)


@plain
def is_damped(model, table):
    """Return whether the integrator of a copy of a model damps implicitly, with a mass matrix of its own."""
    if int_at(model + _at(table, MODEL.opt_integrator)) != _EULER:
        return True
    if int_at(model + _at(table, MODEL.opt_disableflags)) & _NO_DAMPING:
        return False
    nv, joints = long_at(model + _at(table, MODEL.nv)), long_at(model + _at(table, MODEL.njnt))
    damping = floats(long_at(model + _at(table, MODEL.dof_damping)), nv)
    more = floats(long_at(model + _at(table, MODEL.dof_dampingpoly)), _POLYNOMIAL * nv)
    for i in range(nv):
        if damping[i] != 0.0:
            return True
    for i in range(_POLYNOMIAL * nv):
        if more[i] != 0.0:
            return True
    actuator = ints(long_at(model + _at(table, MODEL.jnt_actuatorid)), joints)
    for i in range(joints):
        if actuator[i] != -1:
            return True
    return False


@plain
def limit_margins(w, reach):
    """Reduce margins so that no contact is found farther away than this reach, m."""
    for field, many in _MARGINS[:3]:
        margin = model_floats(w, field, size(w, many))
        np.minimum(margin, reach, margin)


@plain
def scale_margins(w, share):
    """Multiply all margins by a factor."""
    for field, many in _MARGINS:
        margin = model_floats(w, field, size(w, many))
        np.multiply(margin, share, margin)


@plain
def keep_margins(w, kept):
    """Write all margins to an array, (room,)."""
    for field, many in _MARGINS:
        n = size(w, many)
        put(kept, model_floats(w, field, n))
        kept = kept[n:]


@plain
def widen_margins(w, least):
    """Increase all margins to at least those that `keep_margins` has written."""
    for field, many in _MARGINS:
        margin = model_floats(w, field, size(w, many))
        np.maximum(margin, least[: len(margin)], margin)
        least = least[len(margin) :]


@plain
def widen_limits(w, reach):
    """Increase margins so that limits of joints are found at least up to this reach, m or rad."""
    margin = model_floats(w, MODEL.jnt_margin, size(w, MODEL.njnt))
    np.maximum(margin, reach, margin)
