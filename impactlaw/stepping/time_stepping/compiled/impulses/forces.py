"""Coriolis and gyroscopic forces that create no energy, as in `inertial_forces`."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, kernel, norm, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, model_ints, size, velocity_of
from impactlaw.stepping.compiled.fields import DATA, MODEL, address_of
from impactlaw.stepping.compiled.whitening import apply_inverse
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.world import metric_of, swap
from impactlaw.stepping.time_stepping.inertial_forces import FAST, HALF_ROUNDS, HALF_SETTLED, ROUNDS, SETTLED, STILL

_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


@kernel
def forces_at(w, velocity, bias):
    """Write the forces at a velocity, with gravity, (nv,) each; the velocity of data stays unchanged."""
    now = velocity_of(w)
    swap(now, velocity)
    mj.com_vel(w.model, w.data)
    mj.rne(w.model, w.data, 0, address_of(bias))
    if size(w, MODEL.ntendon) > 0:
        mj.tendon_bias(w.model, w.data, address_of(bias))
    swap(now, velocity)


@kernel
def lead_to(w, start, bias, free):
    """Write the velocity without contact for given inertial forces with gravity, (nv,) each; see `settle`."""
    forces, old = data_floats(w, DATA.qfrc_smooth, w.nv), data_floats(w, DATA.qfrc_bias, w.nv)
    for i in range(w.nv):
        free[i] = forces[i] + old[i] - bias[i]
    kick(w, start, w.timestep, free)


@kernel
def kick(w, velocity, h, force):
    """Replace a force by the velocity after it has acted for a time h, (nv,) each."""
    apply_inverse(metric_of(w), force)
    for i in range(w.nv):
        force[i] = velocity[i] + h * force[i]


@linked(BOOLEAN(WORLD, NUMBERS, NUMBERS, types.float64, MARKS, *[NUMBERS] * 3), counts=False)
def half(w, velocity, gravity, h, turning, mean, before, force):
    """Write the forces in half a step that ends at a velocity, or begins there if h < 0, without gravity.

    ``mean`` and ``before`` are scratch space; all are (nv,). Return whether the iteration has converged; trees for
    which it has not are marked as turning too fast.
    """
    largest = 0.0
    forces_at(w, velocity, force)
    for k in range(HALF_ROUNDS + 1):
        largest, change = 0.0, 0.0
        for i in range(w.nv):
            force[i] -= gravity[i]
            largest, change = max(largest, abs(force[i])), max(change, abs(force[i] - before[i]))
        if k > 0 and change <= HALF_SETTLED * largest and norm(force) < np.inf:
            return True
        if k < HALF_ROUNDS:
            put(before, force)
            put(mean, force)
            kick(w, velocity, 0.25 * h, mean)
            forces_at(w, mean, force)
    tree = model_ints(w, MODEL.dof_treeid, w.nv)
    for i in range(w.nv):
        turning[tree[i]] = turning[tree[i]] or not abs(force[i] - before[i]) <= HALF_SETTLED * largest
    return False


@plain
def created(w, start, used, bias):
    """Return the kinetic energy that these forces create in a step from a velocity to that of data, J.

    ``used`` are the forces in that step, with gravity; ``bias`` is scratch space. All are (nv,).
    """
    after, begin, energy = velocity_of(w), data_floats(w, DATA.qfrc_bias, w.nv), 0.0
    forces_at(w, after, bias)
    for i in range(w.nv):
        energy += after[i] * bias[i] + start[i] * begin[i] - (start[i] + after[i]) * used[i]
    return 0.5 * w.timestep * energy


@plain
def split(w, start, gravity, begin, end, bias, moved, free):
    """Write the velocity added before a collision between two half steps, and the velocity without contact.

    ``bias`` is scratch space; all are (nv,).
    """
    for i in range(w.nv):
        moved[i], bias[i] = end[i] - begin[i], 0.0
    kick(w, bias, 0.5 * w.timestep, moved)
    for i in range(w.nv):
        bias[i] = gravity[i] + 0.5 * (begin[i] + end[i])
    lead_to(w, start, bias, free)


@plain
def stale(w, after, end, used, mean):
    """Return the energy due to a half step with other forces than its own, J; ``mean`` is scratch space."""
    put(mean, end)
    kick(w, after, 0.25 * w.timestep, mean)
    energy = 0.0
    for i in range(w.nv):
        energy += mean[i] * (end[i] - used[i])
    return 0.5 * w.timestep * energy


@plain
def _find_fast(w, velocity, turning):
    """Mark the trees of bodies that turn by a large angle in a timestep; return whether there are any."""
    joints, tree, some = size(w, MODEL.njnt), model_ints(w, MODEL.dof_treeid, w.nv), False
    kind, first = model_ints(w, MODEL.jnt_type, joints), model_ints(w, MODEL.jnt_dofadr, joints)
    for j in range(joints):
        if kind[j] == _SLIDE:
            continue
        begin = first[j] + (3 if kind[j] == _FREE else 0)
        for i in range(begin, begin + (1 if kind[j] == _HINGE else 3)):
            if w.timestep * abs(velocity[i]) > FAST:
                turning[tree[i]] = some = True
    return some


@plain
def _is_loose(w, before, free, t):
    """Return whether an iteration has changed the velocity of a tree of bodies by much, (nv,) each."""
    largest, change = 0.0, 0.0
    first = model_ints(w, MODEL.tree_dofadr, size(w, MODEL.ntree))[t]
    end = first + model_ints(w, MODEL.tree_dofnum, size(w, MODEL.ntree))[t]
    for i in range(first, end):
        largest, change = max(largest, abs(free[i])), max(change, abs(free[i] - before[i]))
    return change > SETTLED * largest + STILL or not norm(free[first:end]) < np.inf


@plain
def settle(w, start, held, bias, turning, gravity, room):
    """Set qvel to the velocity without contact; mark the trees of bodies that turn too fast for the timestep.

    Args:
        w: the world in the middle of the step; qvel is the velocity with the inertial forces at the start.
        start: velocity at the start, (nv,).
        held: change of velocity that contact is expected to make, (nv,).
        bias: the final inertial forces, with gravity, (nv,), written.
        turning: bool (ntree,), written.
        gravity: force of gravity in the middle of the step, (nv,), written if there are such trees.
        room: scratch space for three velocities, (3 nv,).
    """
    velocity, nv, tree, settled = velocity_of(w), w.nv, model_ints(w, MODEL.dof_treeid, w.nv), False
    free, before, mean = room[:nv], room[nv : 2 * nv], room[2 * nv : 3 * nv]
    put(free, velocity)
    some = _find_fast(w, start, turning)
    for _ in range(ROUNDS):
        for i in range(nv):
            before[i], mean[i] = free[i], 0.5 * (start[i] + free[i] + held[i])
        forces_at(w, mean, bias)
        lead_to(w, start, bias, free)
        settled = True
        for t in range(size(w, MODEL.ntree)):
            settled = settled and not _is_loose(w, before, free, t)
        if settled:
            break
    if some or not settled:
        clear(mean)
        forces_at(w, mean, gravity)
    if not settled:
        for i in range(nv):
            if _is_loose(w, before, free, tree[i]):
                turning[tree[i]] = True
                bias[i] = gravity[i]
        lead_to(w, start, bias, free)
    put(velocity, free)
