"""How far collision detection has to reach: as far as each body and joint can move until the next look at contacts."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled

_LEAST = 1e-5
"""Reach at rest, m or rad: contacts that are held are to be found."""
_PLANE, _FIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)


def body_sizes(model: mujoco.MjModel) -> np.ndarray:
    """Return the largest distance of a point of each body's geoms from its center of mass, m, (nbody,)."""
    size = np.zeros(model.nbody)
    solid = np.flatnonzero((model.geom_type != _PLANE) & (model.geom_type != _FIELD))
    body = model.geom_bodyid[solid]
    away = np.linalg.norm(model.geom_pos[solid] - model.body_ipos[body], axis=1)
    np.maximum.at(size, body, model.geom_rbound[solid] + away)
    return size


@compiled()
def set_margins(
    body_margin, geom_margin, pair_margin, joint_margin, tendon_margin, body_of_geom, root, size, center, subtree,
    velocity, mocap, surface_speed, dof_of_joint, type_of_joint, qvel, qacc, tendon_velocity, timestep, gravity,
):  # fmt: skip
    """Write margins of bodies, geoms, pairs, joints and tendons, m or rad, for one step.

    MuJoCo takes the larger margin of two geoms: it is twice what the body itself can travel in the step.

    Args:
        body_margin: to be written, like the other margins, (nbody,).
        geom_margin: (ngeom,).
        pair_margin: (npair,).
        joint_margin: (njnt,).
        tendon_margin: (ntendon,).
        body_of_geom: body of each geom, (ngeom,).
        root: root of each body's tree, (nbody,).
        size: `body_sizes`, (nbody,).
        center: centers of mass of bodies, (nbody, 3).
        subtree: centers of mass of subtrees, (nbody, 3).
        velocity: MuJoCo's cvel, about the center of mass of the tree, (nbody, 6).
        mocap: which mocap body each body is, or -1, (nbody,).
        surface_speed: of the fastest point of mocap bodies, m/s.
        dof_of_joint: first degree of freedom of each joint, (njnt,).
        type_of_joint: (njnt,).
        qvel: velocity, (nv,).
        qacc: acceleration of the last step, (nv,).
        tendon_velocity: (ntendon,).
        timestep: h, s.
        gravity: its magnitude, m/s^2.
    """
    far = 0.0
    for i in range(len(body_margin)):
        w0, w1, w2 = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        r0 = center[i, 0] - subtree[root[i], 0]
        r1 = center[i, 1] - subtree[root[i], 1]
        r2 = center[i, 2] - subtree[root[i], 2]
        v0 = velocity[i, 3] + w1 * r2 - w2 * r1
        v1 = velocity[i, 4] + w2 * r0 - w0 * r2
        v2 = velocity[i, 5] + w0 * r1 - w1 * r0
        speed = np.sqrt(v0 * v0 + v1 * v1 + v2 * v2) + np.sqrt(w0 * w0 + w1 * w1 + w2 * w2) * size[i]
        if mocap[root[i]] >= 0:
            speed += surface_speed
        reach = 0.0 if i == 0 else 2.0 * timestep * (speed + timestep * gravity) + _LEAST
        body_margin[i] = reach
        far = max(far, reach)
    for i in range(len(geom_margin)):
        geom_margin[i] = body_margin[body_of_geom[i]]
    for i in range(len(pair_margin)):
        pair_margin[i] = far
    for i in range(len(joint_margin)):
        rows = 1
        if type_of_joint[i] == 1:
            rows = 3
        elif type_of_joint[i] == 0:
            rows = 0
        speed = 0.0
        for k in range(dof_of_joint[i], dof_of_joint[i] + rows):
            speed = max(speed, abs(qvel[k]) + timestep * abs(qacc[k]))
        joint_margin[i] = 2.0 * timestep * speed + _LEAST
    for i in range(len(tendon_margin)):
        tendon_margin[i] = 2.0 * timestep * abs(tendon_velocity[i]) + _LEAST
