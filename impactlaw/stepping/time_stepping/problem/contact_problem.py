"""The problem of one step: impulses of contacts, limits, equalities and dry friction all at once, and what follows."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.solve import linked_solve
from impactlaw.stepping.compiled.whitening import unwhiten
from impactlaw.stepping.time_stepping.problem.targets import offsets

TOLERANCE = 1e-10
"""Natural map, relative to the largest velocity of the problem, that solvers aim at."""

_UNSOLVED = 1e-8  # natural map above which normal velocities are corrected ...
_CORRECTIONS = 2  # ... so many times
_CONVEX = np.bool_(False)  # numba would compile the solver once more for a literal
_FEW = 0  # rounds of slower methods in a search
_SEARCHES = 12  # of the share of restitution that creates no energy
_CREATED = 1e-9  # part of the largest energy of a contact, up to which its creation is rounding
_SLOP = 1e-8  # m or rad: overlaps up to this are left to the velocities
_SWEEPS = 40  # over contacts that overlap
_SETTLED = 1e-4  # part of the velocity needed that is no change any more
_OPENING = 0.2  # m/s or rad/s at which overlaps of the start are opened at least
_OPENING_TIME = 0.1  # s in which most of a deep one is


@compiled()
def recall(groups, key, scale, known_groups, known_key, known_scale, known):
    """Return the impulses of the step before where the same group has as many rows, else zeros, (n,).

    Groups of one key are matched in their order. The search goes on where the last match was: the order rarely changes.
    """
    x = np.zeros(len(scale))
    m, at = len(known_key), 0
    for g in range(len(key)):
        for step in range(m):
            j = at + step if at + step < m else at + step - m
            if known_key[j] != key[g]:
                continue
            if known_groups[1, j] == groups[1, g]:
                for k in range(groups[1, g]):
                    old = known_groups[0, j] + k
                    x[groups[0, g] + k] = known[old] * known_scale[old] / scale[groups[0, g] + k]
            at = j + 1 if j + 1 < m else 0
            break
    return x


@compiled()
def row_velocities(sparse, colind, value, rates, z):
    """Return the velocity of each row after impulses that change the whitened velocity by z, (n,)."""
    after = rates[2].copy()
    for r in range(len(after)):
        s = 0.0
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            s += value[a] * z[colind[a]]
        after[r] += s / rates[0, r]
    return after


@plain
def contact_work(groups, rates, after, x):
    """Return ``Lambda^T (gamma- + gamma+) / 2`` of all contacts, J, and the sum of the sizes of its terms."""
    work, total = 0.0, 0.0
    for g in range(groups.shape[1]):
        if groups[2, g] == CONE:
            for k in range(groups[0, g], groups[0, g] + groups[1, g]):
                impulse = 0.5 * x[k] * rates[0, k]
                work += impulse * (rates[1, k] + after[k])
                total += abs(impulse) * (abs(rates[1, k]) + abs(after[k]))
    return work, total


@compiled()
def solve_rows(sparse, colind, value, groups, amounts, rates, b, guess, tree, exact, rounds):
    """Return x and z of the problem of a step with the offset b, (n,); see `impactlaw.solvers.cones.solve`."""
    x, z, residual, _ = linked_solve(
        sparse[0], sparse[1], colind, value, len(tree), tree, groups[0], groups[1], groups[2], amounts[1], rates[4], b,
        guess, exact, TOLERANCE, rounds,
    )  # fmt: skip
    if residual > _UNSOLVED:
        for _ in range(_CORRECTIONS):
            y, w, left = correct_normals(sparse, colind, value, groups, amounts, rates, b, x, tree, rounds)
            if left > _UNSOLVED:  # normal velocities contradict each other
                break
            x, z = y, w
    return x, z


@compiled()
def correct_normals(sparse, colind, value, groups, amounts, rates, b, guess, tree, rounds):
    """Return x and z where normal velocities are exact, and the natural map of what was solved for that.

    Friction is held: cut to its cone, and the same in a solution.

    It is what makes problems hard: what is left, ``0 <= Lambda_n  ⊥  u_n >= 0``, is convex.
    """
    nv, x, offset = len(tree), guess.copy(), b.copy()
    friction = np.zeros(nv)
    for g in range(groups.shape[1]):
        if groups[2, g] != CONE:
            continue
        row, end = groups[0, g], groups[0, g] + groups[1, g]
        size = 0.0
        for k in range(row + 1, end):
            size += x[k] * x[k]
        share = min(1.0, x[row] / np.sqrt(size)) if size > 0.0 else 1.0
        for k in range(row + 1, end):
            for a in range(sparse[1, k], sparse[1, k] + sparse[0, k]):
                friction[colind[a]] += share * x[k] * value[a]
            x[k] *= share
    for r in range(len(b)):
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            offset[r] += value[a] * friction[colind[a]]
    start, size = x.copy(), np.ones_like(groups[1])
    for g in range(groups.shape[1]):
        for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
            start[k] = 0.0
    normal, z, left, _ = linked_solve(
        sparse[0], sparse[1], colind, value, nv, tree, groups[0], size, groups[2], amounts[1], rates[4], offset,
        start, _CONVEX, TOLERANCE, rounds,
    )  # fmt: skip
    for g in range(groups.shape[1]):
        x[groups[0, g]] = normal[groups[0, g]]
    return x, z + friction, left


@compiled()
def solve_scaled(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, guess, tree, exact, rounds
):  # fmt: skip
    """Solve the problem of a step with all restitution of contacts that collide scaled by s.

    Returns:
        Impulses (n,), in units of the problem; whitened jump of velocities (nv,); velocities of rows afterwards (n,);
        the targets with s, (g,).
    """
    scaled, aimed = target.copy(), sliding.copy()
    for g in range(len(target)):
        if collides[g] and s < 1.0:
            scaled[g] = s * target[g] if target[g] > 0.0 else target[g]
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                aimed[k] = s * sliding[k]
    b = offsets(groups, rates, scaled, aimed)
    x, z = solve_rows(sparse, colind, value, groups, amounts, rates, b, guess, tree, exact, rounds)
    return x, z, row_velocities(sparse, colind, value, rates, z), scaled


@compiled()
def largest_share(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, guess, tree, exact, rounds
):  # fmt: skip
    """Return the largest s found with which the collision by itself creates no energy, and what it creates with 1, J.

    The collision by itself starts from v- and knows no forces; its contacts do ``Lambda^T (gamma- + gamma+) / 2``. With
    friction, or a matrix E, that can be positive (T. R. Kane, *A dynamics puzzle*, 1984); with s = 0 it is not.
    """
    alone = rates.copy()
    alone[2] = rates[1]
    for g in range(len(target)):
        if groups[2, g] == BILATERAL:
            alone[3, groups[0, g]] = rates[1, groups[0, g]]
    low, high, s, gained = 0.0, 1.0, 1.0, 0.0
    for search in range(_SEARCHES):
        x, _, after, _ = solve_scaled(
            sparse, colind, value, groups, amounts, alone, target, sliding, collides, s, guess, tree, exact, rounds
        )
        work, total = contact_work(groups, alone, after, x)
        if work <= _CREATED * total:
            low = s
            if s == 1.0:
                break
        else:
            high = s
            gained = work if search == 0 else gained
        guess = x
        s = 0.5 * (low + high)
    return low, gained


@compiled()
def solve_contacts(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, guess, tree, exact, dissipative, rounds
):  # fmt: skip
    """Solve the problem of a step, with all restitution scaled so that collisions create no energy.

    ``0 <= Lambda  ⊥  J v+ - s gamma^h >= 0`` where contacts collide, with friction in its cones.

    Returns:
        What `solve_scaled` returns; s; and the energy that the collision would create with s = 1, J.
    """
    s, created = 1.0, 0.0
    x, z, after, scaled = solve_scaled(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, guess, tree, exact, rounds
    )
    if collides.any():
        work, total = contact_work(groups, rates, after, x)
        if work > _CREATED * total:
            s, created = largest_share(
                sparse,
                colind,
                value,
                groups,
                amounts,
                rates,
                target,
                sliding,
                collides,
                x,
                tree,
                exact,
                min(rounds, _FEW),
            )
            if not dissipative:
                s = 1.0
    if s < 1.0:
        x, z, after, scaled = solve_scaled(
            sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, x, tree, exact, rounds
        )
    return x, z, after, scaled, s, created


@compiled()
def overlap_targets(groups, amounts, rates, after, timestep):
    """Return how fast positions beside the velocities are to open overlaps, m/s, (g,), and whether any has to.

    What the velocities do until the middle of the next step counts, and between bodies until the end of this one.
    Overlaps that came about in the step before are opened at once, those of the start
    at a limited speed.
    """
    need = np.zeros(groups.shape[1])
    some = False
    for g in range(len(need)):
        if groups[2, g] == CONE:
            row, gap = groups[0, g], amounts[0, g]
            aim = min(0.0, gap + timestep * (_OPENING + abs(rates[1, row]) - min(gap, 0.0) / _OPENING_TIME))
            opened = after[row] * (0.5 if after[row] > 0.0 and groups[3, g] >= 0 else 1.0)
            need[g] = (aim - gap) / timestep - opened
            some = some or (gap < 0.0 and need[g] > _SLOP / timestep)
    return need, some


@compiled()
def open_overlaps(sparse, colind, value, groups, rates, need, nv):
    """Return a small whitened velocity, (nv,), that moves positions as is needed: ``J w >= need``, no friction.

    By projected Gauss-Seidel, whose error the next step corrects.
    """
    z, x = np.zeros(nv), np.zeros(len(need))
    largest = 0.0
    for g in range(len(need)):
        if groups[2, g] == CONE:
            largest = max(largest, need[g])
    for _ in range(_SWEEPS):
        change = 0.0
        for g in range(len(need)):
            if groups[2, g] != CONE and groups[2, g] != BILATERAL:
                continue
            row = groups[0, g]
            begin, end = sparse[1, row], sparse[1, row] + sparse[0, row]
            soft = rates[4, row] if groups[2, g] == BILATERAL else 0.0
            velocity, G = soft * x[g], soft
            for a in range(begin, end):
                velocity += value[a] * z[colind[a]]
                G += value[a] * value[a]
            if G == 0.0:
                continue
            new = x[g] - velocity / G if groups[2, g] == BILATERAL else max(0.0, x[g] + (need[g] - velocity) / G)
            step = new - x[g]
            x[g] = new
            change = max(change, abs(step) * G)
            for a in range(begin, end):
                z[colind[a]] += step * value[a]
        if change <= _SETTLED * largest:
            break
    return z


@compiled(
    "Tuple((float64[::1],float64[::1],float64[::1],float64[::1],float64,float64,float64,float64,float64,float64,"
    "float64[::1]))"
    "(int32[:,::1],int32[::1],float64[::1],int32[:,::1],int64[::1],float64[:,::1],float64[:,::1],float64[::1],"
    "float64[::1],boolean[::1],int32[:,::1],int64[::1],float64[::1],float64[::1],float64,boolean,boolean,int64,"
    "int32[::1],float64[::1],float64[::1],int32[::1],int32[::1],int32[::1])"
)
def resolve_step(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides,
    known_groups, known_key, known_scale, known, timestep, exact, dissipative, rounds, tree,
    factor, inverse, Mnnz, Madr, Mcol,
):  # fmt: skip
    """Return what the contacts of a step do.

    Returns:
        Impulses (n,), in units of the problem; the change of velocity (nv,); the velocity that opens overlaps (nv,),
        empty if none has to be; the targets reached for (g,); the largest amount by which a contact velocity misses its
        target, and the largest velocity of a row, m/s or rad/s; the share s of restitution; the energy that the
        collision would create without it, J; the work of contact, J, with what of it is rounding; and the whitened
        change of velocity (nv,).
    """
    guess = recall(groups, key, rates[0], known_groups, known_key, known_scale, known)
    x, z, after, reached, s, created = solve_contacts(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, guess, tree, exact, dissipative,
        rounds,
    )  # fmt: skip
    root = np.sqrt(inverse)
    change = unwhiten(z, factor, Mnnz, Madr, Mcol, root)
    missed, fastest = 0.0, 0.0
    for g in range(len(reached)):
        if groups[2, g] == CONE:
            row = groups[0, g]
            missed = max(missed, reached[g] - after[row])
            for k in range(row, row + groups[1, g]):
                fastest = max(fastest, abs(rates[1, k]), abs(rates[2, k]))
    need, overlaps = overlap_targets(groups, amounts, rates, after, timestep)
    shift = np.empty(0)
    if overlaps:
        w = open_overlaps(sparse, colind, value, groups, rates, need, len(tree))
        shift = unwhiten(w, factor, Mnnz, Madr, Mcol, root)
    work, total = contact_work(groups, rates, after, x)
    return x, change, shift, reached, missed, fastest, s, created, work, _CREATED * total, z


linked_step = linked(resolve_step)
"""What compiled functions call."""
