"""Contacts that bounce by themselves, held back in compiled code; see `soft.rebounds`."""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import numbers, once, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_ints, data_floats, number, offset, option, rows_of
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, float_at
from impactlaw.stepping.soft.compiled.found import find, normal_velocities
from impactlaw.stepping.soft.tolerances import STILL, UNDERDAMPED

_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


@plain
def bounces(w):
    """Return whether a contact or limit that MuJoCo's solver acts on is a spring that its damping does not quiet."""
    n, first = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    if n == first:
        return False
    impedance = rows_of(w, DATA.efc_KBIP, n, 4)
    for r in range(first, n):
        if impedance[r, 1] * impedance[r, 1] < UNDERDAMPED * 4.0 * impedance[r, 0]:
            return True
    return False


@plain
def update_velocity(w):
    """Bring the velocity stage up to date, as `mj_forward` does."""
    mj.fwd_velocity(w.model, w.data)
    mj.sensor_vel(w.model, w.data)
    if option(w, MODEL.opt_enableflags) & _ENERGY:
        mj.energy_vel(w.model, w.data)


@once
def hold_back(w, law):
    """Cut down reference accelerations by what would be a rebound; return whether any is."""
    n, found = number(w, DATA.nefc), find(w, law.bilateral[:0])
    impedance, wanted, h = rows_of(w, DATA.efc_KBIP, n, 4), data_floats(w, DATA.efc_aref, n), len(found.row)
    gamma, accelerations, held = numbers(h), numbers(h), False
    normal_velocities(found, data_floats(w, DATA.efc_vel, n), gamma)
    normal_velocities(found, wanted, accelerations)
    timestep = float_at(w.model + offset(w, MODEL.opt_timestep))
    for i in range(h):
        row = found.row[i]
        stiffness, damping = impedance[row, 0], impedance[row, 1]
        excess = accelerations[i] - max((law.rest_speed - gamma[i]) / timestep, -damping * gamma[i])
        if damping * damping < UNDERDAMPED * 4.0 * stiffness and gamma[i] > -STILL and excess > 0.0:
            held = True
            count = 2 * (contact_ints(w, CONTACT.dim, 1)[found.contact[i], 0] - 1) if found.paired[i] else 1
            for r in range(row, row + count):
                wanted[r] -= excess
    return held
