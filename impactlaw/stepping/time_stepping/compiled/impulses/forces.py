"""Coriolis and gyroscopic forces of which no energy comes, as in `inertial_forces`."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import clear, kernel, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, layout_of, velocity_of
from impactlaw.stepping.compiled.fields import DATA, address_of
from impactlaw.stepping.compiled.whitening import apply_inverse
from impactlaw.stepping.time_stepping.compiled.state.world import metric_of
from impactlaw.stepping.time_stepping.inertial_forces import HALF_ROUNDS, HALF_SETTLED, ROUNDS, SETTLED


@kernel
def forces_at(w, velocity, bias):
    """Write those at a velocity, with gravity, (nv,) each; the velocity of data is left as it was."""
    now = velocity_of(w)
    _swap(now, velocity)
    mj.com_vel(w.model, w.data)
    mj.rne(w.model, w.data, 0, address_of(bias))
    _swap(now, velocity)


@kernel
def lead_to(w, start, bias, free):
    """Write where forces lead without contact, these being a bias, with gravity, (nv,) each; see `settle`."""
    forces, old = data_floats(w, DATA.qfrc_smooth, w.nv), data_floats(w, DATA.qfrc_bias, w.nv)
    for i in range(w.nv):
        free[i] = forces[i] + old[i] - bias[i]
    kick(w, start, w.timestep, free)


@plain
def _swap(one, other):
    for i in range(len(one)):
        one[i], other[i] = other[i], one[i]


@kernel
def kick(w, velocity, h, force):
    """Overwrite a force by the velocity to which it leads in a time h, (nv,) each."""
    factor, inverse = metric_of(w)
    nnz, adr, col = layout_of(w)
    apply_inverse(factor, nnz, adr, col, inverse, force)
    for i in range(w.nv):
        force[i] = velocity[i] + h * force[i]


@kernel
def half(w, velocity, gravity, h, mean, before, force):
    """Write those of half a step that ends at a velocity, or with h < 0 begins there, without gravity.

    Mean and before are room; all are (nv,). Return whether they are settled.
    """
    forces_at(w, velocity, force)
    for k in range(HALF_ROUNDS + 1):
        size, change = 0.0, 0.0
        for i in range(w.nv):
            force[i] -= gravity[i]
            size, change = max(size, abs(force[i])), max(change, abs(force[i] - before[i]))
        if k > 0 and change <= HALF_SETTLED * size:
            return True
        if k < HALF_ROUNDS:
            put(before, force)
            put(mean, force)
            kick(w, velocity, 0.25 * h, mean)
            forces_at(w, mean, force)
    return False


@plain
def created(w, start, used, bias):
    """Return the kinetic energy beside that of other forces in a step from a velocity to that of data, J.

    Those that have led there are `used`, with gravity; there is room for a bias. All are (nv,).
    """
    after, begin, energy = velocity_of(w), data_floats(w, DATA.qfrc_bias, w.nv), 0.0
    forces_at(w, after, bias)
    for i in range(w.nv):
        energy += after[i] * bias[i] + start[i] * begin[i] - (start[i] + after[i]) * used[i]
    return 0.5 * w.timestep * energy


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
    """Let qvel be where forces lead without contact; return whether bodies turn slowly enough for the timestep.

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
        for i in range(nv):
            before[i], mean[i] = free[i], 0.5 * (start[i] + free[i])
        forces_at(w, mean, bias)
        lead_to(w, start, bias, free)
        if _is_settled(before, free):
            put(velocity, free)
            return True
    clear(mean)
    forces_at(w, mean, bias)
    lead_to(w, start, bias, velocity)
    return False
