"""Collisions of one instant in compiled code, as `collisions.Collider` resolves them."""

from __future__ import annotations

import numpy as np

from impactlaw.mechanics.tolerances import SIGNIFICANT
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.solvers.cones.solve import linked_solve
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_floats,
    data_ints,
    layout_of,
    model_ints,
    number,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, keep
from impactlaw.stepping.compiled.whitening import unwhiten
from impactlaw.stepping.soft.compiled.rows import find, normal_velocities, reached_by, read, within_reach
from impactlaw.stepping.soft.compiled.world import FINE, PYTHON, UNKNOWN
from impactlaw.stepping.soft.tolerances import ROUNDING

COUNT, ENERGY, INTENSITY, DISTANT = 0, 1, 2, 3
"""Places in the sums over collisions: their number, T+ - T-, |v+ - v-|, those with a distant effect."""

_TOLERANCE = 1e-13  # relative natural map that the solver aims at
_ENOUGH = 1e-12  # what it must reach
_ROUNDS = 24  # of its slower methods
_CREATED = 1e-12  # energy, relative to the one before, up to which its creation is rounding


@kernel
def _key(w, found, i):
    """Return the key of a contact or limit; see `law_table.Coefficients`."""
    c, row = found.contact[i], found.row[i]
    if c < 0:
        n = number(w, DATA.nefc)
        return -1 - (np.int64(data_ints(w, DATA.efc_id, n)[row]) * 8 + data_ints(w, DATA.efc_type, n)[row])
    one, other = contact_ints(w, CONTACT.geom, 2)[c, 0], contact_ints(w, CONTACT.geom, 2)[c, 1]
    return (np.int64(min(one, other)) << 32) + max(one, other)


@kernel
def _offsets(w, law, found, rows, members, velocity):
    """Return velocities of rows, less those aimed at, and velocities before, (n,) each; and whether all e are known."""
    n = len(rows.nnz)
    b, before = np.zeros(n), np.zeros(n)
    for g in members:
        i = rows.of[g]
        row, first = found.row[i], rows.first[g]
        e = law.restitution
        if np.isnan(e):
            key = _key(w, found, i)
            at = np.searchsorted(law.key, key)
            if at == len(law.key) or law.key[at] != key:
                law.asked[0] = key
                return b, before, False
            e = law.value[at]
        for r in range(first, first + rows.count[g]):
            s = 0.0
            for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
                s += rows.val[a] * velocity[rows.col[a]]
            before[r] = s
            b[r] = (1.0 + (e if r == first else law.sliding)) * s
    return b, before, True


@plain
def _whitened_velocity(w, velocity, Mnnz, Madr, Mcol, factor, root, z):
    """Write ``D^1/2 L v``, (nv,), whose products with whitened rows are the velocities of these."""
    for i in range(w.nv):
        s = velocity[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s += factor[a] * velocity[Mcol[a]]
        z[i] = s / root[i]


@plain
def _book(found, rows, members, length, x, before, after, gamma_scale, sums):
    """Add a collision to the sums; return its work, J."""
    work, distant = 0.0, False
    for g in members:
        first = rows.first[g]
        for r in range(first, first + rows.count[g]):
            work += 0.5 * x[r] * (before[r] + after[r])
        mean = 0.5 * (before[first] + after[first])
        distant = distant or (x[first] * length[g] > gamma_scale and mean > gamma_scale * length[g])
    sums[COUNT] += 1.0
    sums[ENERGY] += work
    sums[DISTANT] += distant
    return work


@kernel
def _resolve(w, law, found, gamma, rounding, velocity, sums):
    """Resolve one collision: change the velocity, (nv,), and add to the sums; return how it has ended."""
    rows = read(w, found, within_reach(w, found, gamma, law.rest_speed, rounding), law.frictional)
    members = reached_by(rows, gamma, law.rest_speed, w.nv)
    k, n = len(members), len(rows.nnz)
    Mnnz, Madr, Mcol = layout_of(w)
    factor, root = data_floats(w, DATA.qLD, size(w, MODEL.nC)), np.sqrt(data_floats(w, DATA.qLDiagInv, w.nv))
    whitened = np.empty(w.nv)
    _whitened_velocity(w, velocity, Mnnz, Madr, Mcol, factor, root, whitened)
    b, before, known = _offsets(w, law, found, rows, members, whitened)
    if not known:
        return UNKNOWN
    first, count, kind = rows.first[members], rows.count[members], np.full(k, CONE, np.int32)
    x, z, residual, _ = linked_solve(
        rows.nnz, rows.adr, rows.col, rows.val, w.nv, model_ints(w, MODEL.dof_treeid, w.nv), first, count, kind,
        np.zeros(k), np.zeros(n), b, np.zeros(n), law.exact, _TOLERANCE, _ROUNDS,
    )  # fmt: skip
    if not residual <= _ENOUGH:
        return PYTHON
    speed, changed = np.sqrt((whitened * whitened).sum()), np.sqrt((z * z).sum())
    length, after = np.zeros(len(rows.of)), before.copy()
    for r in range(n):
        for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
            after[r] += rows.val[a] * z[rows.col[a]]
    for g in members:
        r = rows.first[g]
        for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
            length[g] += rows.val[a] ** 2
        length[g] = np.sqrt(length[g])
    work = _book(found, rows, members, length, x, before, after, SIGNIFICANT * speed, sums)
    sums[INTENSITY] += changed
    larger = max(speed, changed)
    if 2.0 * work > (_CREATED + 4.0 * residual) * larger * larger:
        return PYTHON
    velocity += unwhiten(z, factor, Mnnz, Madr, Mcol, root)
    return FINE


@kernel
def collide(w, law, sums):
    """Resolve the collisions of now; qvel is the velocity after them.

    Args:
        w: the world, velocities of its rows current.
        law: see `world.Law`.
        sums: over the collisions, zeros, (4,), added to.

    Returns:
        How it has ended, and whether qvel is another one.
    """
    n, first = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    speeds = data_floats(w, DATA.efc_vel, n)
    lowest = 0.0
    for r in range(first, n):
        lowest = min(lowest, speeds[r])
    if not lowest < -law.rest_speed:
        return FINE, False
    found = find(w)
    gamma, qvel = np.empty(len(found.row)), velocity_of(w)
    if not normal_velocities(found, speeds, gamma) < -law.rest_speed:
        return FINE, False
    rounding = ROUNDING * np.abs(gamma).max()
    velocity, status, changed = qvel.copy(), FINE, False
    while status == FINE:
        if sums[COUNT] >= law.most:
            return PYTHON, False
        before = velocity.copy()
        status = _resolve(w, law, found, gamma, rounding, velocity, sums)
        if status != FINE or (before == velocity).all():
            break
        changed, rows = True, np.empty(n)
        mj.mul_jac_vec(w.model, w.data, address_of(rows), address_of(velocity))
        keep(rows)
        if not normal_velocities(found, rows, gamma) < -law.rest_speed:
            break
    if status == FINE:
        qvel[:] = velocity
    return status, changed
