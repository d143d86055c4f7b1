"""How far collision detection has to reach: as far as each body and joint can move until the next detection."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import cross, dot, length, minus, plus, row

LEAST = 1e-5
"""Least reach, m or rad, with which closed contacts of bodies at rest are found."""
SLACK = 2.0
"""Ratio of the reach to the travel of a body in a step: more finds contacts in vain, less needs more detections."""
ALWAYS = 1e6
"""Margin, m or rad, with which all limits are found."""
_MOST = mujoco.mjMAXCONPAIR
"""Largest number of contacts that MuJoCo finds between two geoms."""
_PLANE, _FIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)


@plain
def write_sizes(size, kind, body_of_geom, position, bound, center):
    """Write the largest distance of a point of each body's geoms from its center of mass, m, (nbody,).

    Planes and height fields are left out.

    Args:
        size: written.
        kind: MuJoCo's geom_type, (ngeom,).
        body_of_geom: body of each geom, (ngeom,).
        position: positions of geoms in the frames of bodies, (ngeom, 3).
        bound: MuJoCo's geom_rbound, (ngeom,).
        center: centers of mass in the frames of bodies, (nbody, 3).
    """
    for i in range(len(size)):
        size[i] = 0.0
    for i in range(len(body_of_geom)):
        if kind[i] == _PLANE or kind[i] == _FIELD:
            continue
        body = body_of_geom[i]
        size[body] = max(size[body], bound[i] + length(minus(row(position, i), row(center, body))))


@plain
def write_arms(arm, carrier, body_of_geom, position, bound, body_position, parent, mocap):
    """Write how far geoms reach from mocap bodies that carry them, m, (nmocap,); see `moving_surfaces.Surfaces`."""
    for i in range(len(arm)):
        arm[i] = 0.0
    for i in range(len(carrier)):
        if carrier[i] >= 0:
            reach, body = bound[i] + length(row(position, i)), body_of_geom[i]
            while mocap[body] < 0:
                reach, body = reach + length(row(body_position, body)), parent[body]
            arm[carrier[i]] = max(arm[carrier[i]], reach)


@plain
def _center_square(velocity, along, arm):
    """Return the squared speed of a body's center of mass relative to the motion `along`; both are rows of cvel."""
    v = plus(minus(velocity[3:], along[3:]), 1.0, cross(minus(velocity, along), arm))
    return dot(v, v)


@plain
def _speed(velocity, along, arm, size):
    """Return a bound of the speed of points of a body relative to the motion `along`, m/s."""
    return np.sqrt(_center_square(velocity, along, arm)) + length(minus(velocity, along)) * size


@plain
def _arm(i, root, center, subtree):
    return minus(row(center, i), row(subtree, root[i]))


@plain
def _leader(tree):
    """Return the first body of the only tree of bodies; the world, 0, if there are several trees or none."""
    first = 0
    for i in range(len(tree)):
        if tree[i] > 0:
            return 0
        if tree[i] == 0 and first == 0:
            first = i
    return first


@plain
def _calm_leader(root, tree, center, subtree, velocity):
    """Return the leader if bodies are slower relative to it than relative to the world, else the world."""
    leader, slower = _leader(tree), 0.0
    for i in range(len(tree) if leader != 0 else 0):
        if tree[i] == 0:
            arm = _arm(i, root, center, subtree)
            slower += _center_square(velocity[i], velocity[0], arm)
            slower -= _center_square(velocity[i], velocity[leader], arm)
    return leader if slower > 0.0 else 0


@plain
def _pass_by(leader, root, tree, size, center, subtree, velocity):
    """Return a bound of the speed of the world relative to the leader, at points of its tree's bodies, m/s."""
    far, largest, at = 0.0, 0.0, (0.0, 0.0, 0.0)
    for i in range(len(tree)):
        if tree[i] == 0:
            arm = _arm(i, root, center, subtree)
            far, largest = max(far, dot(arm, arm)), max(largest, size[i])
    return _speed(velocity[leader], velocity[0], at, np.sqrt(far) + largest)


@plain
def outruns(
    body_margin, geom_margin, body_of_geom, root, tree, size, center, subtree, velocity, timestep
):  # fmt: skip
    """Return whether a body moves farther in a timestep than contacts were looked for.

    It must do so relative to the world, and also in the frame of the leader, in which the world moves, too.

    The margins are those with which contacts were looked for; margins of geoms are smaller if another geom of the body
    has a gap. ``velocity`` is MuJoCo's cvel for the velocity after contact. For all arguments see `write_margins`.
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


@plain
def write_margins(
    body_margin, geom_margin, geom_gap, pair_margin, pair_gap, joint_margin, tendon_margin, body_of_geom, root, tree,
    size, center, subtree, velocity, led_to, mocap, surface_speed, timestep, gravity,
):  # fmt: skip
    """Write margins of bodies, geoms, pairs, joints and tendons, m or rad, for one step.

    MuJoCo adds up the margins of two geoms: each is `SLACK` times the distance that the body of the geom can travel in
    the step. If all moving bodies belong to one tree, their motion is taken relative to the first body of that tree, if
    this is slower: then a falling robot does not find contacts between all of its own parts. In this case the world
    gets a margin, too, since it moves relative to the robot. Limits of joints and tendons are always found; those that
    are far are left out by `reader.read_rows`.

    Args:
        body_margin: margins of bodies, (nbody,), written.
        geom_margin: margins of geoms, (ngeom,), written.
        geom_gap: distance beyond the margins at which MuJoCo looks for contacts, m, (ngeom,); it is added to the
            margins, and set to 0.
        pair_margin: margins of pairs, (npair,), written.
        pair_gap: the same distance for pairs, m, (npair,).
        joint_margin: margins of limits of joints, (njnt,), written.
        tendon_margin: margins of limits of tendons, (ntendon,), written.
        body_of_geom: body of each geom, (ngeom,).
        root: the body on the world that carries each body, (nbody,).
        tree: tree of each body, or -1 if it has no degrees of freedom, (nbody,).
        size: result of `write_sizes`, (nbody,).
        center: centers of mass of bodies, (nbody, 3).
        subtree: centers of mass of subtrees, (nbody, 3).
        velocity: MuJoCo's cvel, about the center of mass of the tree, (nbody, 6).
        led_to: cvel for the velocity to which forces lead without contact, (nbody, 6).
        mocap: index of the mocap body that each body is, or -1, (nbody,).
        surface_speed: speed of the fastest point of mocap bodies, m/s.
        timestep: h, s.
        gravity: magnitude of gravity, m/s^2.
    """
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


@plain
def narrow(geoms, shape, geom_margin, pair_margin, share):
    """Scale down the margins of geoms with more contacts with a height field than MuJoCo finds, `mjMAXCONPAIR`.

    MuJoCo goes through the prisms of the field by rows, and stops at that number: the nearest can be missing. Return
    whether there are such geoms.

    Args:
        geoms: geoms of contacts, (ncon, 2).
        shape: MuJoCo's geom_type, (ngeom,).
        geom_margin: margins of geoms, m, (ngeom,), written.
        pair_margin: margins of pairs, m, (npair,), written.
        share: the factor.
    """
    found, many = False, 0
    for c in range(len(geoms)):
        one, other = geoms[c, 0], geoms[c, 1]
        many = many + 1 if c > 0 and one == geoms[c - 1, 0] and other == geoms[c - 1, 1] else 1
        if many == _MOST and min(one, other) >= 0 and (shape[one] == _FIELD or shape[other] == _FIELD):
            geom_margin[one], geom_margin[other] = share * geom_margin[one], share * geom_margin[other]
            found = True
    for i in range(len(pair_margin) if found else 0):
        pair_margin[i] *= share
    return found
