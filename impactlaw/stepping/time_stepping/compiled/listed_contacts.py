"""MuJoCo's list of contacts and their forces at the end of a step, as readers of data and sensors expect them."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.solvers.cones.algebra.loops import integers, kernel, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    contacts_of,
    data_at,
    offset,
    row_floats,
    row_ints,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, SIZE, ints, put_int
from impactlaw.stepping.time_stepping.tolerances import LEAST

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_ROUNDING = 1e-12  # force up to which a contact does not push, relative to the largest of the step


@plain
def leave_open_out(w, force):
    """Remove open contacts that do not push from MuJoCo's list; return how many are left.

    Contacts are looked for farther away than MuJoCo lists them: readers of the list and sensors take each for a touch.
    Rounding of the solvers is no push. ``force`` is that of rows with elliptic cones, (nefc,).
    """
    gap, address, dim = contacts_of(w)[0], contact_ints(w, CONTACT.efc_address, 1), contact_ints(w, CONTACT.dim, 1)
    contacts = ints(data_at(w, DATA.contact), (len(gap), offset(w, SIZE.contact) // 4))
    owners, count, least = row_ints(w, DATA.efc_id), 0, 0.0
    for each in force:
        least = max(least, _ROUNDING * abs(each))
    for i in range(len(gap)):
        row = address[i, 0]
        if gap[i] > LEAST and not (row >= 0 and abs(force[row]) > least):
            continue
        if count < i:
            for k in range(contacts.shape[1]):
                contacts[i, k], contacts[count, k] = contacts[count, k], contacts[i, k]
        count += 1
    if count < len(gap):
        for i in range(len(gap)):
            for row in range(address[i, 0], address[i, 0] + dim[i, 0] if address[i, 0] >= 0 else 0):
                owners[row] = i
    put_int(w.data + offset(w, DATA.ncon), np.int32(count))
    return count


@kernel
def write_pyramids(w, force):
    """Write forces of rows with elliptic cones, (nefc,), as forces of rows with pyramidal cones.

    They are half of ``f_n / m ± f_k / mu_k`` each.
    """
    address, dim = contact_ints(w, CONTACT.efc_address, 1), contact_ints(w, CONTACT.dim, 1)
    friction, elliptic = contact_floats(w, CONTACT.friction, 5), integers(len(dim))
    put(elliptic, address[:, 0])
    put_int(w.model + offset(w, MODEL.opt_cone), np.int32(_PYRAMIDAL))
    mj.make_constraint(w.model, w.data)
    out = row_floats(w, DATA.efc_force)
    first = len(out)
    for i in range(len(dim)):
        if address[i, 0] >= 0:
            first = min(first, address[i, 0])
    for r in range(len(out)):
        out[r] = force[r] if r < min(first, len(force)) else 0.0
    for i in range(len(dim)):
        at, row = address[i, 0], elliptic[i]
        if at < 0 or row < 0:
            continue
        if dim[i, 0] == 1:
            out[at] = force[row]
        for k in range(1, dim[i, 0]):
            normal, along = force[row] / (dim[i, 0] - 1), force[row + k] / friction[i, k - 1]
            out[at + 2 * (k - 1)] = 0.5 * (normal + along)
            out[at + 2 * (k - 1) + 1] = 0.5 * (normal - along)
