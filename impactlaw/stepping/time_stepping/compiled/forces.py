"""Coriolis and gyroscopic forces at the mean velocity of a step, as in `inertial_forces`."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import copied, kernel, numbers, once, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, layout_of, velocity_of
from impactlaw.stepping.compiled.fields import DATA, address_of, put
from impactlaw.stepping.compiled.whitening import solve_inertia
from impactlaw.stepping.time_stepping.compiled.state.world import metric_of
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS, SETTLED


@once
def _allowed(w, start, free):
    """Return ``v^T M v`` of the start, with twice the work of other forces, relative to ``v^T M v`` of the end."""
    momentum = numbers(w.nv)
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


@kernel
def lead_to(w, start, mean, bias):
    """Return where forces lead without contact if these are those of a mean velocity, (nv,); see `settle`."""
    velocity = velocity_of(w)
    kept = copied(velocity)
    put(velocity, mean)
    mj.com_vel(w.model, w.data)
    mj.rne(w.model, w.data, 0, address_of(bias))
    put(velocity, kept)
    factor, inverse = metric_of(w)
    nnz, adr, col = layout_of(w)
    force = data_floats(w, DATA.qfrc_smooth, w.nv) + data_floats(w, DATA.qfrc_bias, w.nv) - bias
    return start + w.timestep * solve_inertia(force, factor, nnz, adr, col, inverse)


@plain
def inertial_work(w, start, after, bias):
    """Return the work that these forces do from one velocity to another, (nv,) each, J."""
    work = 0.0
    for i in range(w.nv):
        work += bias[i] * (start[i] + after[i])
    return -0.5 * w.timestep * work


@once
def settle(w, start, bias):
    """Return where forces lead without contact, (nv,).

    Args:
        w: the world in the middle of the step; qvel is where they lead with these forces as at the start.
        start: velocity at the start, (nv,).
        bias: these forces as they are last, (nv,), to be written.
    """
    free = velocity_of(w).copy()
    for _ in range(ROUNDS):
        before = free
        free = lead_to(w, start, 0.5 * (start + free), bias)
        if np.abs(free - before).max() <= SETTLED * np.abs(free).max():
            return free
    factor, inverse = metric_of(w)
    nnz, adr, col = layout_of(w)
    force = data_floats(w, DATA.qfrc_smooth, w.nv)
    free = start + w.timestep * solve_inertia(force, factor, nnz, adr, col, inverse)
    return free * min(1.0, np.sqrt(_allowed(w, start, free)))
