"""The motion of mocap bodies around the middle of a step, which carry geoms and other bodies."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import kernel, norm, numbers, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, keep


@plain
def carried_at(axis, body, point, carriers):
    """Return a component of the velocity at which a mocap body carries a point, m/s.

    Args:
        axis: component.
        body: address of the mocap body, or -1.
        point: m, (3,).
        carriers: position, m, (nmocap, 3), quaternions, (nmocap, 4), and velocities of mocap bodies, (nmocap, 6), or
            (0, 6) if none moves.
    """
    (place, _, velocity), i, j = carriers, (axis + 1) % 3, (axis + 2) % 3
    if body < 0 or len(velocity) == 0:
        return 0.0
    turning = velocity[body, 3 + i] * (point[j] - place[body, j]) - velocity[body, 3 + j] * (point[i] - place[body, i])
    return velocity[body, axis] + turning


@plain
def carried(axis, g, point, geometry, carriers):
    """Return a component of the velocity at which a mocap body carries a point of a geom, m/s."""
    _, body_of_geom, _, _, root, mocap = geometry
    return carried_at(axis, mocap[root[body_of_geom[g]]], point, carriers)


@kernel
def carry_on(carriers, time, position, quaternion):
    """Write where mocap bodies are after some time, m, (nmocap, 3), and their quaternions, (nmocap, 4)."""
    (place, turn, velocity), axis, moved = carriers, numbers(3), numbers(4)
    position[:], quaternion[:] = place, turn
    for b in range(len(velocity)):
        for i in range(3):
            position[b, i] += time * velocity[b, i]
            axis[i] = time * velocity[b, 3 + i]
        angle = norm(axis)
        if angle > 0.0:
            for i in range(3):
                axis[i] /= angle
            mj.axis_angle_to_quat(address_of(moved), address_of(axis), angle)
            mj.mul_quat(address_of(quaternion[b]), address_of(moved), address_of(turn[b]))
    keep(axis)
    keep(moved)
