"""How far collision detection has to reach: as far as each body and joint can move until the next look at contacts."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones.algebra.loops import plain

LEAST = 1e-5
"""Reach at rest, m or rad: contacts that are held are to be found."""
SLACK = 2.0
"""Reach over what a body travels in a step: more finds contacts in vain, less has more collisions look twice."""
ALWAYS = 1e6
"""Reach, m or rad, within which all limits are."""
_PLANE, _FIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)


@plain
def write_sizes(size, kind, body_of_geom, position, bound, center):
    """Do what `find_sizes` does."""
    for i in range(len(size)):
        size[i] = 0.0
    for i in range(len(body_of_geom)):
        if kind[i] == _PLANE or kind[i] == _FIELD:
            continue
        body = body_of_geom[i]
        x, y, z = position[i, 0] - center[body, 0], position[i, 1] - center[body, 1], position[i, 2] - center[body, 2]
        size[body] = max(size[body], bound[i] + np.sqrt(x * x + y * y + z * z))


@compiled()
def find_sizes(size, kind, body_of_geom, position, bound, center):
    """Write the largest distance of a point of each body's geoms from its center of mass, m, (nbody,).

    Args:
        size: to be written.
        kind: MuJoCo's geom_type, (ngeom,).
        body_of_geom: body of each geom, (ngeom,).
        position: of geoms, from the frames of bodies, (ngeom, 3).
        bound: MuJoCo's geom_rbound, (ngeom,).
        center: centers of mass, from the frames of bodies, (nbody, 3).
    """
    write_sizes(size, kind, body_of_geom, position, bound, center)


@plain
def write_arms(arm, carrier, body_of_geom, position, bound, body_position, parent, mocap):
    """Write how far geoms reach from mocap bodies that carry them, m, (nmocap,); see `moving_surfaces.Surfaces`."""
    for i in range(len(arm)):
        arm[i] = 0.0
    for i in range(len(carrier)):
        if carrier[i] >= 0:
            reach, body = bound[i] + _length(position[i]), body_of_geom[i]
            while mocap[body] < 0:
                reach, body = reach + _length(body_position[body]), parent[body]
            arm[carrier[i]] = max(arm[carrier[i]], reach)


@plain
def _length(v):
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@plain
def _center_square(velocity, along, arm):
    """Return the square of how fast a body's center of mass is for one who moves along, from rows of MuJoCo's cvel."""
    w0, w1, w2 = velocity[0] - along[0], velocity[1] - along[1], velocity[2] - along[2]
    v0 = velocity[3] - along[3] + w1 * arm[2] - w2 * arm[1]
    v1 = velocity[4] - along[4] + w2 * arm[0] - w0 * arm[2]
    v2 = velocity[5] - along[5] + w0 * arm[1] - w1 * arm[0]
    return v0 * v0 + v1 * v1 + v2 * v2


@plain
def _speed(velocity, along, arm, size):
    """Return how fast a point of a body can be for one who moves along, m/s."""
    w0, w1, w2 = velocity[0] - along[0], velocity[1] - along[1], velocity[2] - along[2]
    return np.sqrt(_center_square(velocity, along, arm)) + np.sqrt(w0 * w0 + w1 * w1 + w2 * w2) * size


@plain
def _arm(i, root, center, subtree):
    about = subtree[root[i]]
    return center[i, 0] - about[0], center[i, 1] - about[1], center[i, 2] - about[2]


@plain
def _leader(tree):
    """Return the first body of the only tree of bodies, or where there are more, the world, 0."""
    first = 0
    for i in range(len(tree)):
        if tree[i] > 0:
            return 0
        if tree[i] == 0 and first == 0:
            first = i
    return first


@plain
def _calm_leader(root, tree, center, subtree, velocity):
    """Return the leader if bodies are slower for it than for the world, else the world."""
    leader, slower = _leader(tree), 0.0
    for i in range(len(tree) if leader != 0 else 0):
        if tree[i] == 0:
            arm = _arm(i, root, center, subtree)
            slower += _center_square(velocity[i], velocity[0], arm)
            slower -= _center_square(velocity[i], velocity[leader], arm)
    return leader if slower > 0.0 else 0


@plain
def _pass_by(leader, root, tree, size, center, subtree, velocity):
    """Return how fast points of the world pass by where bodies of the leader's tree are, m/s, for who moves along."""
    far, largest, at = 0.0, 0.0, (0.0, 0.0, 0.0)
    for i in range(len(tree)):
        if tree[i] == 0:
            x, y, z = _arm(i, root, center, subtree)
            far, largest = max(far, x * x + y * y + z * z), max(largest, size[i])
    return _speed(velocity[leader], velocity[0], at, np.sqrt(far) + largest)


@plain
def outruns(
    body_margin, geom_margin, body_of_geom, root, tree, size, center, subtree, velocity, timestep
):  # fmt: skip
    """Return whether some body moves farther in a timestep than contacts were looked for.

    It does not if it does not for one who moves along with the leader.

    Args:
        body_margin: that they were looked for with, m, (nbody,).
        geom_margin: the same of geoms, which is less where another geom of the body has a gap, (ngeom,).
        body_of_geom: see `set_margins`, like the six that follow.
        root: the body on the world that carries each body.
        tree: of bodies.
        size: of bodies.
        center: of bodies.
        subtree: centers of mass.
        velocity: MuJoCo's cvel, of what contact has led to, (nbody, 6).
        timestep: h, s.
    """
    leader, margins = _leader(tree), (body_margin, geom_margin, body_of_geom)
    far = _is_far(margins, root, tree, size, center, subtree, velocity, timestep, 0)
    if far and leader != 0:
        travel = timestep * _pass_by(leader, root, tree, size, center, subtree, velocity)
        far = travel > body_margin[0]
        for g in range(len(geom_margin)):
            far = far or (tree[body_of_geom[g]] < 0 and travel > geom_margin[g])
        return far or _is_far(margins, root, tree, size, center, subtree, velocity, timestep, leader)
    return far


@plain
def _is_far(margins, root, tree, size, center, subtree, velocity, timestep, leader):
    body_margin, geom_margin, body_of_geom = margins
    for i in range(len(tree)):
        if tree[i] >= 0:
            speed = _speed(velocity[i], velocity[leader], _arm(i, root, center, subtree), size[i])
            if timestep * speed > body_margin[i]:
                return True
    for g in range(len(geom_margin)):
        i = body_of_geom[g]
        if tree[i] >= 0 and geom_margin[g] < body_margin[i]:
            speed = _speed(velocity[i], velocity[leader], _arm(i, root, center, subtree), size[i])
            if timestep * speed > geom_margin[g]:
                return True
    return False


@compiled()
def find_outrun(
    body_margin, geom_margin, body_of_geom, root, tree, size, center, subtree, velocity, timestep
):  # fmt: skip
    """Do what `outruns` does."""
    return outruns(
        body_margin, geom_margin, body_of_geom, root, tree, size, center, subtree, velocity, timestep
    )  # fmt: skip


@plain
def write_margins(
    body_margin, geom_margin, geom_gap, pair_margin, pair_gap, joint_margin, tendon_margin, body_of_geom, root, tree,
    size, center, subtree, velocity, led_to, mocap, surface_speed, timestep, gravity,
):  # fmt: skip
    """Do what `set_margins` does."""
    leader = _calm_leader(root, tree, center, subtree, velocity)
    for i in range(len(tree)):
        arm = _arm(i, root, center, subtree)
        speed = _speed(velocity[i], velocity[leader], arm, size[i])
        speed = max(speed, _speed(led_to[i], led_to[leader], arm, size[i]))
        if mocap[root[i]] >= 0:
            speed += surface_speed
        body_margin[i] = 0.0 if i == 0 else SLACK * timestep * (speed + timestep * gravity) + LEAST
    if leader != 0:
        speed = _pass_by(leader, root, tree, size, center, subtree, velocity)
        speed = max(speed, _pass_by(leader, root, tree, size, center, subtree, led_to))
        for i in range(len(tree)):
            if tree[i] < 0:
                body_margin[i] = SLACK * timestep * (speed + surface_speed)
    far = 0.0
    for i in range(len(tree)):
        far = max(far, body_margin[i])
    for i in range(len(geom_margin)):
        geom_margin[i], geom_gap[i] = body_margin[body_of_geom[i]] + geom_gap[i], 0.0
    for i in range(len(geom_margin)):
        body_margin[body_of_geom[i]] = max(body_margin[body_of_geom[i]], geom_margin[i])
    for i in range(len(pair_margin)):
        pair_margin[i], pair_gap[i] = 2.0 * far + pair_gap[i], 0.0
    joint_margin[:] = ALWAYS
    tendon_margin[:] = ALWAYS


@compiled()
def set_margins(
    body_margin, geom_margin, geom_gap, pair_margin, pair_gap, joint_margin, tendon_margin, body_of_geom, root, tree,
    size, center, subtree, velocity, led_to, mocap, surface_speed, timestep, gravity,
):  # fmt: skip
    """Write margins of bodies, geoms, pairs, joints and tendons, m or rad, for one step.

    MuJoCo adds up the margins of two geoms: each is what its own body can travel in the step, and some more. Where
    all that moves is one tree, it is what they travel for one who moves along with the first body of that, if this is
    less: a robot that falls does not find all parts of its own. The world has a margin there, too, for it passes by.
    Limits of joints and tendons are always found; those that are far are left out by `rows.read_rows`.

    Args:
        body_margin: to be written, like the other margins, (nbody,).
        geom_margin: (ngeom,).
        geom_gap: what MuJoCo would look for beyond margins, m, (ngeom,): it becomes a part of them, and 0.
        pair_margin: (npair,).
        pair_gap: the same of pairs, m, (npair,).
        joint_margin: (njnt,).
        tendon_margin: (ntendon,).
        body_of_geom: body of each geom, (ngeom,).
        root: the body on the world that carries each body, (nbody,).
        tree: of each body, or -1 if it has no degrees of freedom, (nbody,).
        size: `find_sizes`, (nbody,).
        center: centers of mass of bodies, (nbody, 3).
        subtree: centers of mass of subtrees, (nbody, 3).
        velocity: MuJoCo's cvel, about the center of mass of the tree, (nbody, 6).
        led_to: the same where forces lead without contact, (nbody, 6).
        mocap: which mocap body each body is, or -1, (nbody,).
        surface_speed: of the fastest point of mocap bodies, m/s.
        timestep: h, s.
        gravity: its magnitude, m/s^2.
    """
    write_margins(
        body_margin, geom_margin, geom_gap, pair_margin, pair_gap, joint_margin, tendon_margin, body_of_geom, root,
        tree, size, center, subtree, velocity, led_to, mocap, surface_speed, timestep, gravity,
    )  # fmt: skip
