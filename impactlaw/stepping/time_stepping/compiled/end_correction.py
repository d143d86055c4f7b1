"""Correction at the end of a step: contacts of fast-turning bodies deviate from the gradients at the midpoint."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.corrected.side_by_side import line_gap
from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, length, minus, plus, row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, model_ints, shapes_of, size, velocity_of
from impactlaw.stepping.compiled.fields import DATA, MODEL, floats
from impactlaw.stepping.compiled.left_out.hidden_edges import support
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carrier_of
from impactlaw.stepping.time_stepping.compiled.detection.far_contacts import jump_speed
from impactlaw.stepping.time_stepping.compiled.detection.standing_cylinders import PLANE
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surface_speed

_SEEN = 3e-6
"""Smallest depth, m, that requires a correction."""
_DEEP = 1e-4
"""Depth, m or rad, beyond which an overlap is opened over time."""

SLOP = 1e-8
"""Depth, m or rad, that is left uncorrected."""
BEYOND = 4.0
"""Range, as a multiple of the depth, within which opening some contacts can close others."""
CLOSE = 1e-5
"""Least range of this search, m: within less, MuJoCo finds hulls that just touch centimeters deep in each other."""
_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)
ROUNDS = 3
"""Largest number of corrections in a step: where a contact jumps, one does not open all of an overlap."""
LITTLE = 0.5
"""Part of the depth before a correction that may remain if there is to be another one."""
LAST_LOSS = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)


@plain
def _acceleration(w, i):
    """Return a bound on the acceleration of points of a body at constant joint velocities, m/s^2."""
    n, rate, qvel = size(w, MODEL.nbody), data_floats(w, DATA.cdof_dot, (w.nv, 6)), velocity_of(w)
    velocity, center = data_floats(w, DATA.cvel, (n, 6)), data_floats(w, DATA.xipos, (n, 3))
    subtree, root = data_floats(w, DATA.subtree_com, (n, 3)), model_ints(w, MODEL.body_rootid, n)
    first, many = model_ints(w, MODEL.body_dofadr, n), model_ints(w, MODEL.body_dofnum, n)
    parent, sizes = model_ints(w, MODEL.body_parentid, n), floats(w.sizes, n)
    turned, moved, body = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), i  # rate of change of MuJoCo's cvel
    while body > 0:
        for j in range(first[body], first[body] + many[body]):
            turned, moved = plus(turned, qvel[j], rate[j]), plus(moved, qvel[j], rate[j, 3:])
        body = parent[body]
    spin, arm = row(velocity, i), minus(row(center, i), row(subtree, root[i]))
    v = plus(velocity[i, 3:], 1.0, cross(spin, arm))
    moved = plus(plus(moved, 1.0, cross(turned, arm)), 1.0, cross(spin, v))
    return length(moved) + (length(turned) + dot(spin, spin)) * sizes[i]


@plain
def _plane_gap(one, other, shapes):
    """Return the gap between a plane and another geom, m; minus infinity if it is not known in closed form."""
    shape, extent, place, turn = shapes
    if shape[one] != PLANE:
        one, other = other, one
    if shape[one] != PLANE:
        return -np.inf
    normal = axis_of(turn, one, 2)
    x, y, z = axis_of(turn, other, 0), axis_of(turn, other, 1), axis_of(turn, other, 2)
    own = dot(x, normal), dot(y, normal), dot(z, normal)
    gap = dot(normal, minus(row(place, other), row(place, one)))
    return gap - support(shape[other], extent[other], own)


@plain
def _foresee(first, end, g, gaps, rows, timestep):
    """Return what gradients say of the contacts of two geoms.

    This is the least gap at the end of the step, m, how fast contacts slide, m/s, and whether any was deep before it.

    Args:
        first: index of the first contact.
        end: index behind the last contact.
        g: the first group whose source is one of these contacts or a later one.
        gaps: gaps in the middle of the step, m. Contacts without a group would not close within two steps, unless they
            are closed and have no effect.
        rows: see `rows.Rows`.
        timestep: h, s.
    """
    groups, amounts, rates, least, sliding, old = rows.groups, rows.amounts, rows.rates, np.inf, 0.0, False
    for c in range(first, end):
        while g < groups.shape[1] and groups[3, g] < c:
            g += 1
        if g == groups.shape[1] or groups[3, g] > c:
            least = min(least, 0.5 * gaps[c] if gaps[c] > 0.0 else np.inf)
            continue
        row, along = groups[0, g], 0.0
        for k in range(row + 1, row + min(groups[1, g], 3)):
            along += rates[2, k] ** 2
        least, sliding = min(least, amounts[0, g] + timestep * min(rates[2, row], 0.0)), max(sliding, np.sqrt(along))
        old = old or amounts[0, g] - 0.5 * timestep * rates[1, row] < -_DEEP
    return least, sliding, old


@plain
def bend(w, rows, pairs, gaps, again):
    """Return the depth of the deepest overlap at the end of a step, m, and how far to open those of the start, m.

    Both are 0 if no overlap asks for a correction. Overlaps arise because contacts deviate from their gradients. A
    point with acceleration a at constant joint velocities leaves its straight line by ``a (h / 2)^2 / 2``, and a
    contact can jump to another point of a body that turns. Only where this can be more than `_SEEN`, the gap is
    measured; gaps to planes mostly have a closed form. Shallower overlaps are left to the next step. Overlaps that were
    deep at the start are opened over time, here by this deviation.

    Args:
        w: the world at the end of the step.
        rows: the rows of the step.
        pairs: geoms of MuJoCo's contacts in the middle of the step, two for each, (2 ncon,).
        gaps: their gaps, (ncon,).
        again: whether overlaps have been corrected already; then only new overlaps count.
    """
    geoms, shapes, h = pairs.reshape((-1, 2)), shapes_of(w), w.timestep
    shape, velocity = shapes[0], data_floats(w, DATA.cvel, (size(w, MODEL.nbody), 6))
    body_of_geom = model_ints(w, MODEL.geom_bodyid, len(shape))
    g, end, deepest, slow = 0, 0, 0.0, 0.0
    while end < len(geoms):
        first, one, other = end, geoms[end, 0], geoms[end, 1]
        while end < len(geoms) and geoms[end, 0] == one and geoms[end, 1] == other:
            end += 1
        while g < len(rows.key) and rows.groups[3, g] < first:
            g += 1
        gap = _plane_gap(one, other, shapes)
        if gap >= -_SEEN:
            continue
        falls, along, old = _foresee(first, end, g, gaps, rows, h)
        if falls == np.inf or (again and old):
            continue
        turn = 0.125 * h**2 * (_acceleration(w, body_of_geom[one]) + _acceleration(w, body_of_geom[other]))
        turn += 0.5 * h * (along + jump_speed(w, one, other, velocity))
        bends = turn > _SEEN and falls < turn
        measured = bends or (surface_speed(w) > 0.0 and (carrier_of(w, one) >= 0 or carrier_of(w, other) >= 0))
        if gap == -np.inf and not old and measured and shape[one] != _SDF and shape[other] != _SDF:
            gap = line_gap(shapes, one, other)
            if gap == -np.inf:
                gap = mj.geom_distance(w.model, w.data, one, other, APART, 0)
        if gap == -np.inf or old:
            if bends and not again:
                deepest, slow = max(deepest, turn), max(slow, turn)
        elif gap < -_SEEN:
            deepest = max(deepest, -gap)
    return deepest, slow


@kernel
def end_targets(rows, slow, before_key, before, timestep):
    """Return how fast positions must move to open overlaps, m/s, (g,), and whether any must.

    Overlaps that were deep at the start of the step are opened by at most a distance, m, other overlaps completely.

    Args:
        rows: see `rows.Rows`.
        slow: largest opening of old overlaps, m.
        before_key: keys of the groups of the step, (k,).
        before: their gaps at the start of the step, m or rad, (k,).
        timestep: h, s.
    """
    groups, key, amounts, need, some = rows.groups, rows.key, rows.amounts, np.zeros(len(rows.key)), False
    for g in range(len(need)):
        if groups[2, g] != CONE:
            continue
        gap = amounts[0, g]
        need[g] = -gap / timestep
        if gap < -SLOP:
            some = True
            for k in range(len(before)):
                if before_key[k] == key[g] and before[k] < -_DEEP:
                    need[g] = min(-gap, slow) / timestep
    return need, some
