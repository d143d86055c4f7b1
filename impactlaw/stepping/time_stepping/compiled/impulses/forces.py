"""Coriolis and gyroscopic forces at the mean velocity of a step, as in `inertial_forces`."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, layout_of, velocity_of
from impactlaw.stepping.compiled.fields import DATA, address_of
from impactlaw.stepping.compiled.whitening import apply_inverse
from impactlaw.stepping.time_stepping.compiled.state.world import metric_of
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS, SETTLED


@plain
def _allowed(w, start, free, momentum):
    """Return ``v^T M v`` of the start, with twice the work of other forces, relative to ``v^T M v`` of the end.

    There is room for a momentum, (nv,).
    """
    mj.mul_m(w.model, w.data, address_of(momentum), address_of(free))
    after, before, work = 0.0, 0.0, 0.0
    for i in range(w.nv):
        after += momentum[i] * free[i]
    mj.mul_m(w.model, w.data, address_of(momentum), address_of(start))
    force, bias = data_floats(w, DATA.qfrc_smooth, w.nv), data_floats(w, DATA.qfrc_bias, w.nv)
    for i in range(w.nv):
        before += momentum[i] * start[i]
        work += w.timestep * (force[i] + bias[i]) * (start[i] + free[i])
    return (before + max(0.0, work)) / after if after > 0.0 else 1.0


@plain
def lead_to(w, start, mean, bias, free):
    """Write where forces lead without contact if these are those of a mean velocity, (nv,) each; see `settle`."""
    velocity = velocity_of(w)
    _swap(velocity, mean)
    mj.com_vel(w.model, w.data)
    mj.rne(w.model, w.data, 0, address_of(bias))
    _swap(velocity, mean)
    forces, old = data_floats(w, DATA.qfrc_smooth, w.nv), data_floats(w, DATA.qfrc_bias, w.nv)
    for i in range(w.nv):
        free[i] = forces[i] + old[i] - bias[i]
    _move(w, start, free)


@plain
def _swap(one, other):
    for i in range(len(one)):
        one[i], other[i] = other[i], one[i]


@plain
def _move(w, start, force):
    """Overwrite a force by the velocity to which it leads, (nv,)."""
    factor, inverse = metric_of(w)
    nnz, adr, col = layout_of(w)
    apply_inverse(factor, nnz, adr, col, inverse, force)
    for i in range(w.nv):
        force[i] = start[i] + w.timestep * force[i]


@plain
def mean_of(one, other, mean):
    """Write the mean of two velocities, (nv,)."""
    for i in range(len(one)):
        mean[i] = 0.5 * (one[i] + other[i])


@plain
def inertial_work(w, start, after, bias):
    """Return the work that these forces do from one velocity to another, (nv,) each, J."""
    work = 0.0
    for i in range(w.nv):
        work += bias[i] * (start[i] + after[i])
    return -0.5 * w.timestep * work


@plain
def _is_settled(before, free):
    """Return whether a round has hardly changed the velocity, (nv,)."""
    size = 0.0
    for i in range(len(free)):
        size = max(size, abs(free[i]))
    for i in range(len(free)):
        if not abs(free[i] - before[i]) <= SETTLED * size:
            return False
    return True


@plain
def settle(w, start, bias, room):
    """Let qvel be where forces lead without contact.

    Args:
        w: the world in the middle of the step; qvel is where they lead with these forces as at the start.
        start: velocity at the start, (nv,).
        bias: these forces as they are last, (nv,), to be written.
        room: for three velocities, (3 nv,).
    """
    velocity, nv = velocity_of(w), w.nv
    free, before, mean = room[:nv], room[nv : 2 * nv], room[2 * nv : 3 * nv]
    put(free, velocity)
    for _ in range(ROUNDS):
        put(before, free)
        mean_of(start, before, mean)
        lead_to(w, start, mean, bias, free)
        if _is_settled(before, free):
            put(velocity, free)
            return
    put(free, data_floats(w, DATA.qfrc_smooth, nv))
    _move(w, start, free)
    share = min(1.0, np.sqrt(_allowed(w, start, free, mean)))
    for i in range(nv):
        velocity[i] = share * free[i]
