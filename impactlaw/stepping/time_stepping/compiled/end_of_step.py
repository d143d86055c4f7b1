"""The end of a compiled step, after its contact problem: forces in data, corrected gaps, frames and energy."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, cleared, copied, kernel, marks, numbers, plain, put, zeros
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_at,
    data_floats,
    data_ints,
    jacobian_of,
    layout_of_trees,
    model_ints,
    number,
    offset,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, flags, keep, put_int
from impactlaw.stepping.time_stepping.compiled.detection.chosen_rows import leave_tied_out
from impactlaw.stepping.time_stepping.compiled.detection.nearest_points import find_nearest
from impactlaw.stepping.time_stepping.compiled.detection.standing_cylinders import find_standing
from impactlaw.stepping.time_stepping.compiled.end_correction import (
    BEYOND,
    CLOSE,
    LAST_LOSS,
    LITTLE,
    ROUNDS,
    SLOP,
    bend,
    end_targets,
)
from impactlaw.stepping.time_stepping.compiled.impulses.rows import count, read
from impactlaw.stepping.time_stepping.compiled.listed_contacts import leave_open_out, write_pyramids
from impactlaw.stepping.time_stepping.compiled.model_copy import limit_margins, widen_limits
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.room import rows_at, rows_size
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, World, metric_of, setting
from impactlaw.stepping.time_stepping.problem.overlaps import COUNTED, open_overlaps
from impactlaw.stepping.time_stepping.problem.rows import ROWS, entries_of

_PYRAMIDAL, _ELLIPTIC = int(mujoco.mjtCone.mjCONE_PYRAMIDAL), int(mujoco.mjtCone.mjCONE_ELLIPTIC)
_FRICTIONAL = np.bool_(True)


@plain
def update_frames(w):
    """Update frames and velocities of bodies to the state."""
    mj.kinematics(w.model, w.data)
    mj.com_pos(w.model, w.data)
    mj.com_vel(w.model, w.data)


@plain
def update_inertia(w):
    """Update lengths of tendons and the mass matrix to the frames."""
    if size(w, MODEL.ntendon) > 0:
        mj.tendon(w.model, w.data)
    mj.make_m(w.model, w.data)


@plain
def write_forces(w, rows, x, start, cone, force):
    """Write the impulses of the step over h to data, as forces of the cones that the user has chosen.

    ``force``, (nefc,), is scratch space.
    """
    h = w.timestep
    clear(force)
    for r in range(len(x)):
        force[rows.sparse[2, r]] = rows.rates[0, r] * x[r] / h
    mj.mul_jac_t_vec(w.model, w.data, data_at(w, DATA.qfrc_constraint), address_of(force))
    write_acceleration(w, start)
    put(data_floats(w, DATA.efc_force, len(force)), force)
    shown = setting(w, SETTING.forces) != 0.0
    if number(w, DATA.ncon) == 0 or not (shown or size(w, MODEL.nsensordata) > 0):
        return
    if leave_open_out(w, force) > 0 and shown and cone == _PYRAMIDAL:
        write_pyramids(w, force)


@plain
def write_acceleration(w, start):
    """Write the mean acceleration of the step to data."""
    qacc, qvel = data_floats(w, DATA.qacc, w.nv), data_floats(w, DATA.qvel, w.nv)
    for i in range(w.nv):
        qacc[i] = (qvel[i] - start[i]) / w.timestep


@plain
def _find_contacts(w, now):
    """Copy the state to other data, and find its current contacts."""
    nq, mocap, equalities = size(w, MODEL.nq), size(w, MODEL.nmocap), size(w, MODEL.neq)
    put(data_floats(now, DATA.qpos, nq), data_floats(w, DATA.qpos, nq))
    put(data_floats(now, DATA.mocap_pos, 3 * mocap), data_floats(w, DATA.mocap_pos, 3 * mocap))
    put(data_floats(now, DATA.mocap_quat, 4 * mocap), data_floats(w, DATA.mocap_quat, 4 * mocap))
    seen = flags(data_at(now, DATA.eq_active), equalities)
    put(seen, flags(data_at(w, DATA.eq_active), equalities))
    mj.kinematics(w.model, now.data)
    find_standing(now, False)
    find_nearest(now)


@plain
def _overlap(now):
    """Return whether any bodies overlap."""
    distance, some = contact_floats(now, CONTACT.dist, 1), False
    for i in range(len(distance)):
        some = some or distance[i, 0] < -SLOP
    return some


@kernel
def _move_apart(now, qpos, metric, rows, depth, slow):
    """Open the overlaps found in other data by changing qpos, (nq,); return whether there are any."""
    mj.com_pos(now.model, now.data)
    if size(now, MODEL.ntendon) > 0:
        mj.tendon(now.model, now.data)
    mj.make_constraint(now.model, now.data)
    nv, h, n, mark = now.nv, now.timestep, number(now, DATA.nefc), cleared(size(now, MODEL.ntree))
    kinds, position, near = data_ints(now, DATA.efc_type, n), data_floats(now, DATA.efc_pos, n), marks(n)
    for r in range(n):  # what opening overlaps can close
        near[r] = kinds[r] <= LAST_LOSS or position[r] < BEYOND * depth
    jacobian, still = jacobian_of(now, False), zeros(nv)
    leave_tied_out(now, jacobian, near)
    entries, (groups, many) = entries_of(jacobian, layout_of_trees(now), mark), count(now, near, _FRICTIONAL)
    block = numbers(rows_size(groups, many, entries))
    seen = rows_at(address_of(block), groups, many, entries)
    read(now, jacobian, metric, still[:0], still, still, near, _FRICTIONAL, seen)
    before = numbers(len(rows.key))
    for g in range(len(before)):
        before[g] = rows.amounts[0, g] - 0.5 * h * rows.rates[1, rows.groups[0, g]]
    need, found = end_targets(seen, slow, rows.key, before, h)
    if found:
        shift = numbers(nv)
        open_overlaps(seen, need, h, metric, shift)
        mj.integrate_pos(now.model, address_of(qpos), address_of(shift), h)
        keep(shift)
    keep(block)
    return found


@plain
def copy_contacts(w, pairs, gaps):
    """Copy the geoms of contacts, two for each, (2 ncon,), and their gaps, (ncon,), infinite for those without rows."""
    geoms, dist = contact_ints(w, CONTACT.geom, 2), contact_floats(w, CONTACT.dist, 1)
    address = contact_ints(w, CONTACT.efc_address, 1)
    for i in range(len(geoms)):
        pairs[2 * i], pairs[2 * i + 1], gaps[i] = geoms[i, 0], geoms[i, 1], dist[i, 0] if address[i, 0] >= 0 else np.inf


@plain
def _opens(w, rows, depth, slow):
    """Open overlaps of some depth; return whether there are any."""
    put_int(w.model + offset(w, MODEL.opt_cone), np.int32(_ELLIPTIC))
    if setting(w, SETTING.sticks) == 0.0:
        limit_margins(w, max(BEYOND * depth, CLOSE))
    widen_limits(w, BEYOND * depth)
    now = World(
        w.model, w.scratch, w.scratch, w.table, w.settings, w.sizes, w.bilateral, w.nv, w.timestep, w.damped, 0, 0, 0
    )  # fmt: skip
    _find_contacts(w, now)
    if not _overlap(now):
        return False
    opened = _move_apart(now, data_floats(w, DATA.qpos, size(w, MODEL.nq)), metric_of(w), rows, depth, slow)
    if opened:
        update_frames(w)
    return opened


@linked(BOOLEAN(WORLD, ROWS, types.int32[::1], NUMBERS), counts=False)
def correct_end(w, rows, pairs, gaps):
    """Open overlaps at the end of a step that gradients at the midpoint have not shown.

    Return whether new ones of more than `COUNTED` remain. For contacts that the rows belong to see `copy_contacts`.
    """
    depth, slow = bend(w, rows, pairs, gaps, False)
    for _ in range(ROUNDS if depth > 0.0 else 0):
        before, opened = depth, _opens(w, rows, depth, slow)
        depth, slow = bend(w, rows, pairs, gaps, True)
        if not opened or depth == 0.0 or depth > LITTLE * before:
            break
    return depth > COUNTED * setting(w, SETTING.meter)


@plain
def _add_products(w, one, other, factor, sums):
    """Add the inner product of two vectors, restricted to each tree of bodies, to sums, (ntree,)."""
    tree = model_ints(w, MODEL.dof_treeid, w.nv)
    for i in range(w.nv):
        sums[tree[i]] += factor * one[i] * other[i]


@kernel
def _add_energies(w, velocity, sums):
    """Add ``v^T M v`` of each tree at the current configuration to sums, (ntree,)."""
    momentum = numbers(w.nv)
    update_inertia(w)
    mj.mul_m(w.model, w.data, address_of(momentum), address_of(velocity))
    _add_products(w, momentum, velocity, 1.0, sums)
    keep(momentum)


@kernel
def limit_energy(w, start, velocity, turning, gravity):
    """Scale down velocities of trees that turn fast, so that they gain no more energy than forces and contact gave."""
    qpos, after, now = data_floats(w, DATA.qpos, len(start)), velocity_of(w), copied(start)
    tree, trees, force = model_ints(w, MODEL.dof_treeid, w.nv), size(w, MODEL.ntree), numbers(w.nv)
    allowed, found = zeros(trees), zeros(trees)
    smooth, bias = data_floats(w, DATA.qfrc_smooth, w.nv), data_floats(w, DATA.qfrc_bias, w.nv)
    constraint = data_floats(w, DATA.qfrc_constraint, w.nv)
    for i in range(w.nv):
        force[i] = smooth[i] + bias[i] - gravity[i] + constraint[i]
    _add_products(w, force, velocity, w.timestep, allowed)
    _add_products(w, force, after, w.timestep, allowed)
    put(now, qpos)
    put(qpos, start)
    update_frames(w)
    _add_energies(w, velocity, allowed)
    put(qpos, now)
    update_frames(w)
    _add_energies(w, after, found)
    for i in range(w.nv):
        t = tree[i]
        if turning[t] and found[t] > max(0.0, allowed[t]):
            after[i] *= np.sqrt(max(0.0, allowed[t]) / found[t])
    mj.com_vel(w.model, w.data)
