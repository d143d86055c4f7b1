"""RK4 without contacts that are not closed yet, in compiled code; see `soft.without_new_contacts`."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import clear, indices, kernel, numbers, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_floats,
    data_ints,
    model_at,
    model_floats,
    model_ints,
    number,
    offset,
    option,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import (
    CONTACT,
    DATA,
    MODEL,
    SIZE,
    address_of,
    flags,
    float_at,
    int_at,
    keep,
    long_at,
    longs,
    put_int,
)
from impactlaw.stepping.soft.without_new_contacts import BODY, NO_CONTACT, NO_LIMIT, SCALAR, SLEEP, TENDON


@plain
def passes_limit(w):
    """Return the result of `without_new_contacts.passes_limit`."""
    if option(w, MODEL.opt_disableflags) & NO_LIMIT:
        return False
    joints, qvel, acceleration = size(w, MODEL.njnt), velocity_of(w), data_floats(w, DATA.qacc, w.nv)
    kind, limited = model_ints(w, MODEL.jnt_type, joints), flags(model_at(w, MODEL.jnt_limited), joints)
    dof, place = model_ints(w, MODEL.jnt_dofadr, joints), model_ints(w, MODEL.jnt_qposadr, joints)
    margin, ends = model_floats(w, MODEL.jnt_margin, joints), model_floats(w, MODEL.jnt_range, 2 * joints)
    h, qpos = float_at(w.model + offset(w, MODEL.opt_timestep)), data_floats(w, DATA.qpos, size(w, MODEL.nq))
    for j in range(joints):
        if limited[j] != 0 and kind[j] >= SCALAR:
            now, moved = qpos[place[j]], h * (qvel[dof[j]] + 0.5 * h * acceleration[dof[j]])
            lower, upper = now - ends[2 * j] - margin[j], ends[2 * j + 1] - now - margin[j]
            if lower >= 0.0 > lower + moved or upper >= 0.0 > upper - moved:
                return True
    return False


@kernel
def row_numbers(w):
    """Return numbers that identify the current constraint rows, int (nefc,)."""
    n = number(w, DATA.nefc)
    return 8 * data_ints(w, DATA.efc_id, n) + data_ints(w, DATA.efc_type, n)


@kernel
def meets_more(w, geoms, rows):
    """Return whether pairs of geoms have more contacts than before, or there are other limits; see `stages._met`."""
    pairs, ids, first = contact_ints(w, CONTACT.geom, 2), row_numbers(w), number(w, DATA.ne) + number(w, DATA.nf)
    for c in range(len(pairs)):
        more = 0
        for other in pairs:
            more += other[0] == pairs[c, 0] and other[1] == pairs[c, 1]
        for other in geoms:
            more -= other[0] == pairs[c, 0] and other[1] == pairs[c, 1]
        if more > 0:
            return True
    for r in range(first, first + number(w, DATA.nl)):
        if ids[r] % 8 == TENDON or not np.any(rows == ids[r]):
            return True
    return False


@plain
def start_room(w):
    """Return the number of entries that `keep_start` saves."""
    return 3 * w.nv + size(w, MODEL.na) + size(w, MODEL.nC)


@plain
def keep_start(w, kept, back):
    """Save what `without_new_contacts.keep_start` returns into `kept`, (`start_room`,), or write it `back`."""
    at, nv = 0, w.nv
    for place, n in (
        (DATA.qacc, nv), (DATA.qfrc_smooth, nv), (DATA.qfrc_constraint, nv),
        (DATA.act_dot, size(w, MODEL.na)), (DATA.M, size(w, MODEL.nC)),
    ):  # fmt: skip
        if back:
            put(data_floats(w, place, n), kept[at : at + n])
        else:
            put(kept[at:], data_floats(w, place, n))
        at += n


@plain
def is_plain(w):
    """Return the result of `without_new_contacts.is_plain`."""
    more = size(w, MODEL.nplugin) + size(w, MODEL.nhistory)
    return more == 0 and not option(w, MODEL.opt_enableflags) & SLEEP


@kernel
def find_contact_forces(w, found):
    """Write the result of `contact_forces`, (nv,), zeros before; without rows MuJoCo leaves them."""
    n, others = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    if others == 0:
        put(found, data_floats(w, DATA.qfrc_constraint, w.nv))
        return
    forces = numbers(n)
    put(forces, data_floats(w, DATA.efc_force, n))
    clear(forces[:others])
    mj.mul_jac_t_vec(w.model, w.data, address_of(found), address_of(forces))
    keep(forces)


@plain
def _needs_contacts(w):
    """Return the result of `without_new_contacts._needs_contacts`."""
    for kind in model_ints(w, MODEL.actuator_trntype, size(w, MODEL.nactuator)):
        if kind == BODY:
            return True
    sleeps = option(w, MODEL.opt_enableflags) & SLEEP != 0
    return sleeps or flags(w.model + offset(w, MODEL.flg_adhesion), 1)[0] != 0


@kernel
def advance_without_new_contacts(w, pushing):
    """Do what the function of this name in Python does; the forces are (0,) if nothing touches at the start.

    The changed options are in a copy of the model's own structure, since other threads step with the model.
    """
    if len(pushing) > 0 and _needs_contacts(w):
        mj.euler(w.model, w.data)
        return
    words, applied = long_at(w.table + 8 * SIZE.model) // 8, data_floats(w, DATA.qfrc_applied, w.nv)
    copied, before = indices(words), numbers(w.nv)
    model = address_of(copied)
    put(copied, longs(w.model, words))
    put(before, applied)
    for i in range(len(pushing)):
        applied[i] += pushing[i]
    disabled = model + offset(w, MODEL.opt_disableflags)
    put_int(disabled, np.int32(int_at(disabled) | NO_CONTACT))
    mj.runge_kutta(model, w.data, np.int32(4))
    put(applied, before)
    keep(copied)
