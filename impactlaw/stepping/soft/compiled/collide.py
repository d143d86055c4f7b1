"""Collisions of one instant in compiled code, as `collisions.Collider` resolves them."""

from __future__ import annotations

import numpy as np

from impactlaw.mechanics.tolerances import SIGNIFICANT
from impactlaw.scene.equality_constraints import CALM, RESTING
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    clear,
    cleared,
    copied,
    dot,
    indices,
    kernel,
    norm,
    numbers,
    once,
    plain,
    put,
    zeros,
)
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_floats,
    data_ints,
    jacobian_of,
    layout_of,
    model_ints,
    number,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, keep
from impactlaw.stepping.compiled.whitening import unwhitened, whitened
from impactlaw.stepping.soft.compiled.alone import solve_alone
from impactlaw.stepping.soft.compiled.contacts.drifting import leave_drifting_out
from impactlaw.stepping.soft.compiled.contacts.equalities import projected, span
from impactlaw.stepping.soft.compiled.contacts.found import Found, find, normal_velocities, within_reach
from impactlaw.stepping.soft.compiled.contacts.rows import everyone, reached_by, read
from impactlaw.stepping.soft.compiled.contacts.work import most_gained, work_of_each
from impactlaw.stepping.soft.compiled.world import FINE, PYTHON, UNKNOWN
from impactlaw.stepping.soft.tolerances import GAINED, ROUNDING

COUNT, ENERGY, INTENSITY, DISTANT, LAST = 0, 1, 2, 3, 4
"""Places in the sums over collisions: their number, T+ - T-, |v+ - v-|, those with a distant effect, and those that
ended the matter."""
SUMS = 5
"""Numbers of these sums."""

_TOLERANCE = 1e-13  # relative natural map that the solver aims at
_ENOUGH = 1e-12  # what it must reach
_ROUNDS = 24  # of its slower methods
_AGAIN = 4  # times that it goes on from the best point, before Python repeats all of them
_WORTH_IT = 0.5  # part of the natural map that is left, up to which going on was of use
_CREATED = 1e-12  # energy, relative to the one before, up to which its creation is rounding
_DRIVEN = -1  # how a collision has ended that is resolved once more, see `_collide`


@plain
def _key(w, found, i):
    """Return the key of a contact or limit; see `law_table.Coefficients`."""
    c, row = found.contact[i], found.row[i]
    if c < 0:
        n = number(w, DATA.nefc)
        return -1 - (np.int64(data_ints(w, DATA.efc_id, n)[row]) * 8 + data_ints(w, DATA.efc_type, n)[row])
    one, other = contact_ints(w, CONTACT.geom, 2)[c, 0], contact_ints(w, CONTACT.geom, 2)[c, 1]
    return (np.int64(min(one, other)) << 32) + max(one, other)


@plain
def _offsets(w, law, found, rows, members, velocity, last, before, b):
    """Write velocities of rows, and these less what is aimed at, (n,) each; return whether all e are known."""
    for g in members:
        i, first = rows.of[g], rows.first[g]
        e = 0.0 if last else law.restitution
        if np.isnan(e):
            key = _key(w, found, i)
            at = np.searchsorted(law.key, key)
            if at == len(law.key) or law.key[at] != key:
                law.asked[0] = key
                return False
            e = law.value[at]
        for r in range(first, first + rows.sizes[g]):
            for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
                before[r] += rows.val[a] * velocity[rows.col[a]]
            b[r] = (1.0 + (e if r == first or last else law.sliding)) * before[r]
    return True


@once
def _solve(w, law, rows, members, last, b):
    """Return impulses, (n,), jump, (nv,), and the natural map; one contact alone may have a closed form."""
    n, k, exact = len(rows.nnz), len(members), law.last_exact if last else law.exact
    x, z, residual = zeros(n), zeros(w.nv), np.inf
    first, count = rows.first[members[0]], rows.sizes[members[0]]
    if k == 1 and count <= 3 and (exact or count == 1):
        residual = 0.0 if solve_alone(rows, first, count, b, indices(3), numbers(24), x, z) else np.inf
    for _ in range(0 if residual == 0.0 else _AGAIN):
        left, before = numbers(1), residual
        left[0] = 1.0
        residual, _ = linked_improve(
            rows.nnz, rows.adr, rows.col, rows.val, model_ints(w, MODEL.dof_treeid, w.nv), rows.first[members],
            rows.sizes[members], np.full(k, CONE, np.int32), zeros(k), zeros(n), b, exact, _TOLERANCE, _ROUNDS,
            left, x, z,
        )  # fmt: skip
        if residual <= _ENOUGH or not residual < _WORTH_IT * before:
            break
    return x, z, residual


@kernel
def _resolve(w, law, found, gamma, calm, rounding, last, guarded, velocity, sums):
    """Resolve one collision: change the velocity, (nv,), and add to the sums; return how it has ended.

    The last one is of all contacts, with E = 0. If `guarded`, that is `_DRIVEN` where much of the energy is that of
    constraints that give way.
    """
    Mnnz, Madr, Mcol = layout_of(w)
    factor, root = data_floats(w, DATA.qLD, size(w, MODEL.nC)), numbers(w.nv)
    inverse = data_floats(w, DATA.qLDiagInv, w.nv)
    for i in range(w.nv):
        root[i] = np.sqrt(inverse[i])
    jacobian = jacobian_of(w)
    basis = numbers((number(w, DATA.ne) + 1) * w.nv if len(law.bilateral) > 0 else 0)
    kept = span(w, law.bilateral, calm, jacobian, root, basis) if len(basis) > 0 else 0
    reached = cleared(len(gamma))
    if last:
        for i in range(len(gamma)):
            reached[i] = True
    else:
        within_reach(w, found, jacobian, gamma, law.rest_speed, rounding, cleared(size(w, MODEL.ntree)), reached)
    rows = read(w, found, jacobian, reached, root, law.frictional)
    free, moves = rows, True
    if kept > 0:
        rows, moves = projected(free, w.nv, basis, kept)
    if not moves:
        return PYTHON
    members, n = everyone(rows) if last else reached_by(rows, gamma, law.rest_speed, w.nv), len(rows.nnz)
    v, before, b = numbers(w.nv), zeros(n), zeros(n)
    whitened(velocity, factor, Mnnz, Madr, Mcol, root, v)
    if not _offsets(w, law, found, free, members, v, last, before, b):
        return UNKNOWN
    x, z, residual = _solve(w, law, rows, members, last, b)
    if not residual <= _ENOUGH:
        return PYTHON
    speed, changed = norm(v), norm(z)
    done, larger = numbers(len(members)), max(speed, changed)
    distant = work_of_each(rows, members, x, z, before, SIGNIFICANT * speed, done)
    allowed = 0.5 * (_CREATED + 4.0 * residual) * larger * larger
    if most_gained(rows, members, done, allowed, w.nv) > allowed:
        return PYTHON
    gained = dot(v, FIRST, z, FIRST, w.nv) + 0.5 * changed * changed
    if guarded and kept > 0 and gained > 0.5 * GAINED * changed * changed:
        return _DRIVEN
    sums[COUNT] += 1.0
    sums[ENERGY] += gained
    sums[INTENSITY] += changed
    sums[DISTANT] += distant
    unwhitened(z, factor, Mnnz, Madr, Mcol, root, v)
    for i in range(w.nv):
        velocity[i] += v[i]
    return FINE


@plain
def _tell(outcomes, velocity):
    """Write the velocity after a collision, if there is room."""
    n = len(velocity)
    if len(outcomes) > 0:
        at = 1 + np.int64(outcomes[0]) * n
        for i in range(min(n, len(outcomes) - at)):
            outcomes[at + i] = velocity[i]
        outcomes[0] += 1.0


@plain
def _same(one, other):
    for i in range(len(one)):
        if one[i] != other[i]:
            return False
    return True


@kernel
def _collide(w, law, share, sums):
    """Do what `collide` does; constraints that move faster than a share of the fastest contact are giving way.

    `_DRIVEN` is how it has ended where these have driven a collision, unless all were giving way that moved.
    """
    n, speeds = number(w, DATA.nefc), data_floats(w, DATA.efc_vel, number(w, DATA.nefc))
    found = find(w, law.bilateral)
    gamma, qvel = numbers(len(found.row)), velocity_of(w)
    lowest, rounding = normal_velocities(found, speeds, gamma), 0.0
    calm = -share * lowest
    if lowest < -law.rest_speed and len(law.bilateral) > 0 and number(w, DATA.ne) > 0 and number(w, DATA.nl) > 0:
        h = leave_drifting_out(w, law.bilateral, calm, found, gamma)
        found, gamma = Found(found.row[:h], found.contact[:h], found.paired[:h]), gamma[:h]
        lowest = normal_velocities(found, speeds, gamma)
    if not lowest < -law.rest_speed:
        return FINE, False
    for speed in gamma:
        rounding = max(rounding, ROUNDING * abs(speed))
    velocity, before, rows, status, changed = copied(qvel), numbers(w.nv), numbers(n), FINE, False
    while status == FINE:
        last = sums[COUNT] >= law.most
        put(before, velocity)
        status = _resolve(w, law, found, gamma, calm, rounding, last, share > RESTING, velocity, sums)
        if status == FINE:
            _tell(law.outcomes, velocity)
            sums[LAST] += last
        if status != FINE or _same(before, velocity):
            break
        changed = True
        if last:
            break
        mj.mul_jac_vec(w.model, w.data, address_of(rows), address_of(velocity))
        keep(rows)
        if not normal_velocities(found, rows, gamma) < -law.rest_speed:
            break
    if status == FINE:
        put(qvel, velocity)
    return status, changed


@kernel
def collide(w, law, sums):
    """Resolve the collisions of now; qvel is the velocity after them.

    Args:
        w: the world, velocities of its rows current.
        law: see `world.Law`.
        sums: over the collisions, zeros, (`SUMS`,), added to.

    Returns:
        How it has ended, and whether qvel is another one.
    """
    n, first = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    speeds, lowest = data_floats(w, DATA.efc_vel, n), 0.0
    for r in range(first, n):
        lowest = min(lowest, speeds[r])
    if not lowest < -law.rest_speed:
        return FINE, False
    told, status, changed = law.outcomes[0] if len(law.outcomes) > 0 else 0.0, _DRIVEN, False
    for share in (CALM, RESTING):
        if status == _DRIVEN:
            clear(sums)
            if len(law.outcomes) > 0:
                law.outcomes[0] = told
            status, changed = _collide(w, law, share, sums)
    return status, changed
