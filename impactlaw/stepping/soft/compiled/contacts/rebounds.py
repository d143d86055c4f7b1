"""Contacts that bounce by themselves, held back in compiled code; see `soft.rebounds`."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import numbers, once, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_ints, data_at, data_floats, number, offset
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, float_at, keep
from impactlaw.stepping.soft.compiled.contacts.active_contacts import find, normal_velocities
from impactlaw.stepping.soft.tolerances import STILL, UNDERDAMPED


@plain
def bounces(w):
    """Return whether a contact or limit that MuJoCo's solver acts on is an underdamped spring."""
    n, first = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    if n == first:
        return False
    impedance = data_floats(w, DATA.efc_KBIP, (n, 4))
    for r in range(first, n):
        if impedance[r, 1] * impedance[r, 1] < UNDERDAMPED * 4.0 * impedance[r, 0]:
            return True
    return False


@once
def hold_back(w, law):
    """Reduce the reference accelerations of contacts that would rebound; return whether any is."""
    n, found = number(w, DATA.nefc), find(w, law.bilateral[:0])
    table, wanted, h = data_floats(w, DATA.efc_KBIP, (n, 4)), data_floats(w, DATA.efc_aref, n), len(found.row)
    gamma, aim, reached, rows, held = numbers(h), numbers(h), numbers(h), numbers(n), False
    mj.mul_jac_vec(w.model, w.data, address_of(rows), data_at(w, DATA.qacc))
    normal_velocities(found, data_floats(w, DATA.efc_vel, n), gamma)
    normal_velocities(found, wanted, aim)
    normal_velocities(found, rows, reached)
    keep(rows)
    timestep = float_at(w.model + offset(w, MODEL.opt_timestep))
    for i in range(h):
        row = found.row[i]
        stiffness, damping, impedance = table[row, 0], table[row, 1], table[row, 2]
        most = max((law.rest_speed - gamma[i]) / timestep, -damping * gamma[i])
        excess = min((reached[i] - most) / impedance, aim[i] + damping * gamma[i])
        if damping * damping < UNDERDAMPED * 4.0 * stiffness and gamma[i] > -STILL and excess > 0.0:
            held = True
            count = 2 * (contact_ints(w, CONTACT.dim, 1)[found.contact[i], 0] - 1) if found.paired[i] else 1
            for r in range(row, row + count):
                wanted[r] -= excess
    return held
