"""Collisions of one instant in compiled code, as `collisions.Collider` resolves them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.mechanics.tolerances import SIGNIFICANT
from impactlaw.scene.equality_constraints import CALM, RESTING
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    FLOATS,
    clear,
    cleared,
    copied,
    dot,
    equal,
    indices,
    kernel,
    norm,
    numbers,
    once,
    plain,
    put,
    zeros,
)
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_floats,
    data_ints,
    inertia_of,
    jacobian_of,
    model_ints,
    number,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, keep
from impactlaw.stepping.compiled.islands import join_trees, tree_of
from impactlaw.stepping.compiled.whitening import unwhitened, whitened
from impactlaw.stepping.soft.compiled.contacts.active_contacts import (
    ActiveContacts,
    approach_speeds,
    find,
    normal_velocities,
    some_collides,
    within_reach,
)
from impactlaw.stepping.soft.compiled.contacts.drifting_limits import leave_drifting_out
from impactlaw.stepping.soft.compiled.contacts.equalities import Gradients, projected, span
from impactlaw.stepping.soft.compiled.contacts.kinds import FOUND, GRADIENTS, LAW, START, WORLD, typeof
from impactlaw.stepping.soft.compiled.contacts.outcomes import write_outcome
from impactlaw.stepping.soft.compiled.contacts.rows import everyone, reached_by, read
from impactlaw.stepping.soft.compiled.contacts.work import work_of_each
from impactlaw.stepping.soft.compiled.restitution_scaling import ENOUGH, CollisionProblem, find_impulses
from impactlaw.stepping.soft.compiled.world import FINE, PYTHON, UNKNOWN
from impactlaw.stepping.soft.tolerances import GAINED, OPENING, ROUNDING

Array = np.ndarray[Any, Any]

COUNT, ENERGY, INTENSITY, DISTANT, SCALED, LAST, SHORT, WORK = 0, 1, 2, 3, 4, 5, 6, 7
"""Indices of the sums over collisions: their number; T+ - T-; |v+ - v-|; the numbers of collisions with a distant
effect, with scaled restitution, and with E = 0 after too many collisions; whether a collision has lost all restitution
or was left to MuJoCo's contacts; and the part of T+ - T- that is the work of equality constraints that drift."""
SUMS = 8
"""Number of these sums."""

# results of a collision that is left to MuJoCo's contacts, or has to be repeated
_LEFT = -3  # no impulses were found, and all work is used up
_OPPOSED = -2  # restitution would be scaled, and slowly opening contacts took part: repeat without them
_DRIVEN = -1  # constraints that give way have driven it: repeat without them, see `_collide`


class _Islands(NamedTuple):
    """Islands of trees that influence each other; the arrays are empty if there are no equality constraints."""

    label: Array  # for each tree the tree that stands for its island, int64 (ntree,)
    # for the tree that stands for an island, whether constraints that give way have driven a collision there; then
    # constraints that move at all do not take part, bool (ntree,)
    driven: Array


_ISLANDS = typeof(_Islands(np.zeros(0, np.int64), np.zeros(0, np.bool_)))


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
def _ask(w, law, found, rows, members, velocity, last, before, restored):
    """Write the fields `before` and `restored` of `CollisionProblem`, (n,) each; return whether each e is known."""
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
            restored[r] = e * min(before[r], 0.0) if r == first else (e if last else law.sliding) * before[r]
    return True


@kernel
def _some_driven(w, v, z, islands):
    """Mark islands in which constraints that give way have driven a collision; return whether there are new ones.

    There a jump z of the velocity v, both whitened, (nv,), gains more than a part `GAINED` of its energy.
    """
    tree, many, some = model_ints(w, MODEL.dof_treeid, w.nv), len(islands.label), False
    gained, changed = zeros(many), zeros(many)
    for i in range(len(z)):
        t = islands.label[tree[i]]
        gained[t] += z[i] * (v[i] + 0.5 * z[i])
        changed[t] += z[i] * z[i]
    for t in range(many):
        if not islands.driven[t] and gained[t] > 0.5 * GAINED * changed[t]:
            islands.driven[t] = some = True
    return some


@linked(
    types.int64(
        WORLD, LAW, FOUND, FLOATS, FLOATS, FLOATS, _ISLANDS, GRADIENTS, types.float64, types.float64, types.boolean,
        FLOATS, FLOATS,
    )
)  # fmt: skip
def _resolve(w, law, found, gamma, approach, calm, islands, gradients, rounding, opening, last, velocity, sums):
    """Resolve one collision: change the velocity, (nv,), and add to the sums; return its status.

    The last collision is of all contacts, with E = 0. The status is `_DRIVEN` if constraints that give way supply much
    of the energy of an island, see `_Islands`. It is `_OPPOSED` if restitution would be scaled, or no impulses are
    found, while contacts take part that open, at speeds up to `opening`.
    """
    (jacobian, root, basis), inertia = gradients, inertia_of(w)
    kept, reached, trembles = len(basis) // w.nv, cleared(len(gamma)), False
    if last:
        for i in range(len(gamma)):
            reached[i] = True
    else:
        separates = max(rounding, opening)
        within_reach(w, found, jacobian, gamma, approach, separates, cleared(size(w, MODEL.ntree)), reached)
        for i in range(len(gamma)):
            trembles = trembles or (reached[i] and gamma[i] > rounding)
    rows = read(w, found, jacobian, reached, root, law.frictional)
    free, moves = rows, True
    if kept > 0:
        rows, moves = projected(free, w.nv, basis, kept, gamma, approach)
    if not moves:
        return PYTHON
    members, n = everyone(rows) if last else reached_by(rows, gamma, approach, w.nv), len(rows.nnz)
    v, before, restored, x, z = numbers(w.nv), zeros(n), zeros(n), zeros(n), zeros(w.nv)
    whitened(velocity, inertia, root, v)
    if not _ask(w, law, found, free, members, v, last, before, restored):
        return UNKNOWN
    speed = norm(v)
    problem = CollisionProblem(law.last_exact if last else law.exact, before, restored, v, speed, law.left)
    residual, share = find_impulses(w, rows, members, problem, x, z)
    if trembles and (share < 1.0 or not residual <= ENOUGH):
        return _OPPOSED
    if not residual <= ENOUGH:
        return PYTHON if law.left[0] > 0.0 else _LEFT
    changed, done = norm(z), numbers(len(members))
    distant = work_of_each(rows, members, x, z, before, SIGNIFICANT * speed, done)
    gained = dot(v, FIRST, z, FIRST, w.nv) + 0.5 * changed * changed
    if kept > 0 and _some_driven(w, v, z, islands):
        return _DRIVEN
    sums[COUNT] += 1.0
    sums[ENERGY] += gained
    sums[INTENSITY] += changed
    sums[DISTANT] += distant
    sums[SCALED] += share < 1.0
    if kept > 0:
        sums[WORK] += gained - done.sum()
    if share == 0.0:
        sums[SHORT] = 1.0
    unwhitened(z, inertia, root, v)
    if len(law.outcomes) > 0:
        write_outcome(w, law, found, rows, members, problem, share, calm, x, velocity, v)
    for i in range(w.nv):
        velocity[i] += v[i]
    return FINE


@plain
def _find_calm(w, found, gamma, jacobian, islands, calm):
    """Write, for each tree, the speed up to which constraints keep their velocity in a collision, (ntree,).

    It is a part of the speed of the fastest contact of the island. Before, `calm` is zeros.
    """
    (nnz, adr, col, val), tree = jacobian, model_ints(w, MODEL.dof_treeid, w.nv)
    for i in range(len(gamma)):
        t = tree_of(nnz, adr, col, val, found.row[i], tree)
        if t >= 0:
            t = islands.label[t]
            calm[t] = max(calm[t], -gamma[i])
    for t in range(len(calm)):  # only trees that stand for an island; the others copy it below
        if islands.label[t] == t:
            calm[t] *= RESTING if islands.driven[t] else CALM
    for t in range(len(calm)):
        calm[t] = calm[islands.label[t]]


@once
def _gradients(w, law, calm, jacobian):
    """Return the `Gradients` of the current contacts, valid until the function that calls this returns."""
    inverse, root = inertia_of(w).inverse, numbers(w.nv)
    for i in range(w.nv):
        root[i] = np.sqrt(inverse[i])
    basis = numbers((number(w, DATA.ne) + 1) * w.nv if len(calm) > 0 else 0)
    kept = span(w, law.bilateral, calm, jacobian, root, basis) if len(calm) > 0 else 0
    return Gradients(jacobian, root, basis[: kept * w.nv])


@kernel
def _collide(w, law, islands, start, sums):
    """Do what `collide` does, once; constraints that move faster than a part of the fastest contact are giving way.

    The status is `_DRIVEN` if these have driven a collision in an island in which they had not done so before.
    """
    n, speeds = number(w, DATA.nefc), data_floats(w, DATA.efc_vel, number(w, DATA.nefc))
    found = find(w, law.bilateral)
    gamma, qvel = numbers(len(found.row)), velocity_of(w)
    if not normal_velocities(found, speeds, gamma) < -law.rest_speed:
        return FINE, False
    approach = numbers(len(gamma))
    approach_speeds(w, found, gamma, law.rest_speed, start, approach)
    if not some_collides(gamma, approach):
        return FINE, False
    calm, jacobian = zeros(len(islands.label)), jacobian_of(w, True)
    if len(calm) > 0:
        _find_calm(w, found, gamma, jacobian, islands, calm)
    gradients = _gradients(w, law, calm, jacobian)
    if len(gradients.basis) > 0 and number(w, DATA.nl) > 0:
        h = leave_drifting_out(w, gradients, found, gamma)
        found, gamma = ActiveContacts(found.row[:h], found.contact[:h], found.paired[:h]), gamma[:h]
        approach = approach[:h]
        approach_speeds(w, found, gamma, law.rest_speed, start, approach)
        if not some_collides(gamma, approach):
            return FINE, False
    rounding, opening = 0.0, OPENING * law.rest_speed
    for speed in gamma:
        rounding = max(rounding, ROUNDING * abs(speed))
    velocity, before, rows, status, changed = copied(qvel), numbers(w.nv), numbers(n), FINE, False
    while status == FINE:
        last = sums[COUNT] >= law.most or law.left[0] <= 0.0
        put(before, velocity)
        status = _resolve(
            w, law, found, gamma, approach, calm, islands, gradients, rounding, opening, last, velocity, sums
        )
        if status == _OPPOSED:
            status, opening = FINE, 0.0
            continue
        if status == FINE:
            sums[LAST] += last
        if status != FINE or equal(before, velocity):
            break
        changed = True
        if last:
            break
        mj.mul_jac_vec(w.model, w.data, address_of(rows), address_of(velocity))
        keep(rows)
        normal_velocities(found, rows, gamma)
        if not some_collides(gamma, approach):
            break
    if status == FINE:
        put(qvel, velocity)
    return status, changed and status == FINE


@linked(types.Tuple((types.int64, types.boolean))(WORLD, LAW, START, FLOATS))
def collide(w, law, start, sums):
    """Resolve the current collisions, and write the velocity after them into qvel.

    Args:
        w: the world, with current velocities of its rows.
        law: see `world.Law`.
        start: see `world.Start`.
        sums: sums over the collisions, zeros before, (`SUMS`,), written.

    Returns:
        The status, see `world`, and whether qvel has changed.
    """
    n, first = number(w, DATA.nefc), number(w, DATA.ne) + number(w, DATA.nf)
    speeds, lowest = data_floats(w, DATA.efc_vel, n), 0.0
    for r in range(first, n):
        lowest = min(lowest, speeds[r])
    if not lowest < -law.rest_speed:
        return FINE, False
    constrained = len(law.bilateral) > 0 and number(w, DATA.ne) > 0
    trees = size(w, MODEL.ntree) if constrained else 0
    islands = _Islands(indices(trees), cleared(trees))
    if constrained:
        (nnz, adr, col, val), tree = jacobian_of(w, True), model_ints(w, MODEL.dof_treeid, w.nv)
        kinds, of_rows = data_ints(w, DATA.efc_type, n), data_ints(w, DATA.efc_id, n)
        join_trees(kinds, of_rows, nnz, adr, col, val, tree, islands.label)
    law.left[0] = 1.0
    told, status, changed = copied(law.outcomes[:1]), _DRIVEN, False
    while status == _DRIVEN:
        clear(sums)
        put(law.outcomes, told)
        status, changed = _collide(w, law, islands, start, sums)
    if status == _LEFT:
        clear(sums)
        put(law.outcomes, told)
        status, sums[SHORT] = FINE, 1.0
    return status, changed
