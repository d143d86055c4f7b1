"""Find equality constraints that close a limit by drifting, and leave it almost no motion, so that both cannot be met.

To open the limit, the motion that the constraint allows would have to compensate the drift divided by the small
remainder: a knee whose shank slips by 3 mm per radian would turn 300 times as fast as the slip closes. See
`soft.drifting_limits` and `scene.equality_constraints.DRIFT`.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.equality_constraints import CALM, DRIFT, HELD_BY_DRIFT, TYING
from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.algebra.loops import cleared, indices, kernel, plain, zeros
from impactlaw.stepping.time_stepping.problem.energy import find_islands
from impactlaw.stepping.time_stepping.problem.rows import NEAR
from impactlaw.stepping.time_stepping.tolerances import CALM_TIES, DRIVEN, STIFF

_ALL = 1e-12  # squared remainder of a gradient, relative to its square, up to which the constraint takes it completely


@plain
def square_of(rows, row):
    """Return the square of the length of a row."""
    s = 0.0
    for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row]):
        s += rows.value[a] * rows.value[a]
    return s


@plain
def _find_fastest(rows, collides, label, fastest):
    """Write the largest colliding contact velocity of each island, as it is and in the kinetic metric, to zeros."""
    for g in range(len(collides)):
        if collides[g] and label[g] >= 0:
            i, row = label[g], rows.groups[0, g]
            speed = abs(rows.rates[1, row])
            fastest[0, i] = max(fastest[0, i], speed)
            fastest[1, i] = max(fastest[1, i], speed / np.sqrt(max(square_of(rows, row), 1e-300)))


@plain
def _is_closed_by(rows, row, limit, fastest, work):
    """Return whether a constraint, whose row is scattered to ``work``, closes a limit by drifting."""
    sparse, rates = rows.sparse, rows.rates
    product, own, other = 0.0, square_of(rows, row), square_of(rows, limit)
    for a in range(sparse[1, limit], sparse[1, limit] + sparse[0, limit]):
        product += rows.value[a] * work[rows.colind[a]]
    share = product / max(own, 1e-300)
    left = other - share * product
    if not _ALL * other < left <= HELD_BY_DRIFT * HELD_BY_DRIFT * other:
        return False
    drift = share * rates[1, row]
    return abs(drift) > max(CALM * abs(rates[1, limit] - drift), DRIFT * np.sqrt(left) * fastest)


@plain
def _find_drifts(rows, collides, label, fastest, work, found):
    """Write True for the groups that are equality constraints closing a limit by drifting, to an array of False, (g,).

    ``work`` must be zero, (nv,).
    """
    sparse, colind, groups = rows.sparse, rows.colind, rows.groups
    for g in range(len(found)):
        row = groups[0, g]
        if groups[2, g] != BILATERAL or label[g] < 0:
            continue
        for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
            work[colind[a]] = rows.value[a]
        for k in range(len(found)):
            limit = groups[2, k] == CONE and groups[3, k] < -1 and (collides[k] or rows.amounts[0, k] <= NEAR)
            if limit and _is_closed_by(rows, row, groups[0, k], fastest[1, label[g]], work):
                found[g] = True
        for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
            work[colind[a]] = 0.0


@plain
def _is_calm(rows, row, kind, speed, longest):
    """Return whether an equality constraint can keep its velocity in a collision with these largest velocities.

    It can if its velocity is negligible next to the collision. For couplings, whose units differ from those of contact,
    both velocities are taken in the kinetic metric.
    """
    own = abs(rows.rates[1, row])
    if kind == TYING:
        return own <= CALM_TIES * speed
    return kind != 0 and own <= CALM * longest * np.sqrt(square_of(rows, row))


@plain
def _has_constraints(groups):
    some = False
    for kind in groups[2]:
        some = some or kind == BILATERAL
    return some


@kernel
def hold_constraints(rows, collides, kinds, tree):
    """Make equality constraints keep their velocity in a collision, unless they drift too fast.

    Their velocity is compared with the fastest collision of their island, since other collisions cannot influence them.

    Ties do not become so stiff that they could drive the collision. A tie with compliance R, velocity gamma and target
    velocity t does the work ``(t - gamma+) (gamma + gamma+) / 2 R``, at most ``(gamma + t)^2 / 8 R``. Rows that are
    linearly dependent except for a violation come close to that: only the rotation of the whole body resists them.

    Args:
        rows: see `rows.Rows`; compliances are written.
        collides: which groups collide, bool (g,).
        kinds: the kind of each group as in `constraint_kinds`, 0 for other groups, (g,).
        tree: tree of each degree of freedom, (nv,).
    """
    rates, many = rows.rates, rows.groups.shape[1]
    if not _has_constraints(rows.groups):
        return
    label, given = indices(many), cleared(many)
    count = find_islands(rows, tree, label)
    fastest = zeros(2 * count).reshape((2, count))
    _find_fastest(rows, collides, label, fastest)
    _find_drifts(rows, collides, label, fastest, zeros(len(tree)), given)
    for g in range(many):
        row = rows.groups[0, g]
        if rows.groups[2, g] != BILATERAL or label[g] < 0 or fastest[0, label[g]] == 0.0:
            continue
        speed, longest = fastest[:, label[g]]
        full = rows.amounts[1, g]
        held = rates[4, row] < full  # by an earlier collision in the same step
        held = held or _is_calm(rows, row, kinds[g], speed, longest)
        rates[4, row] = full
        if held and not given[g]:
            drift = (rates[1, row] + rates[3, row]) / longest if kinds[g] == TYING else 0.0
            rates[4, row] = min(full, max(STIFF * full, 0.25 * drift * drift / DRIVEN))
