"""How far collision detection has to reach: as far as each body and joint can move until the next detection."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, length, minus, plus, row

LEAST = 1e-5
"""Least reach, m or rad, with which closed contacts of bodies at rest are found."""
SLACK = 2.0
"""Ratio of the reach to the travel of a body in a step: more finds contacts in vain, less needs more detections."""
ALWAYS = 1e6
"""Margin, m or rad, with which all limits are found."""
_MOST = mujoco.mjMAXCONPAIR
"""Largest number of contacts that MuJoCo finds between two geoms."""
_FEW = 48
"""Number of geoms of a tree of bodies below which finding some in vain costs less than the choice of margins."""
_SLOW = 0.015
"""Reach of a body, as a part of its size, up to which its margin alone covers it."""
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
def _speed(i, j, at, bodies, velocity):
    """Return a bound of the speed of body i relative to body j at points of the body `at`, m/s."""
    root, _, _, size, center, subtree = bodies
    one = cross(velocity[i], _arm(at, root[i], center, subtree))
    other = cross(velocity[j], _arm(at, root[j], center, subtree))
    v = plus(minus(velocity[i, 3:], velocity[j, 3:]), 1.0, minus(one, other))
    return length(v) + length(minus(velocity[i], velocity[j])) * size[at]


@plain
def _arm(i, root, center, subtree):
    return minus(row(center, i), row(subtree, root))


@plain
def _are_near(i, j, reach, size, center):
    """Return whether the spheres about two bodies are nearer than a reach, m."""
    apart, within = minus(row(center, i), row(center, j)), size[i] + size[j] + reach
    return dot(apart, apart) < within * within


@plain
def _is_near(i, radius, g, shapes, center):
    """Return whether a sphere about body i meets a geom that does not move."""
    _, kind, place, turn, box = shapes
    apart, square = minus(row(center, i), row(place, g)), 0.0
    if kind[g] == _PLANE:
        return dot(apart, axis_of(turn, g, 2)) < radius
    for k in range(3):
        beyond = abs(dot(apart, axis_of(turn, g, k)) - box[g, k]) - box[g, 3 + k]
        square += max(0.0, beyond) * max(0.0, beyond)
    return square < radius * radius


@plain
def _tree_at(i, reach, bodies):
    """Return the first body after the tree of body i, and the radius of a sphere about body i around that tree, m.

    The sphere has a reach for each body, (nbody,).
    """
    _, tree, _, size, center, _ = bodies
    end, radius = i, 0.0
    while end < len(tree) and tree[end] == tree[i]:
        radius = max(radius, length(minus(row(center, end), row(center, i))) + size[end] + reach[end])
        end += 1
    return end, radius


@plain
def outruns(geom_margin, bodies, shapes, velocity, timestep, work):
    """Return whether a body can reach another one in a timestep from farther than contacts were looked for.

    The margins are those with which contacts were looked for. ``velocity`` is MuJoCo's cvel for the velocity after
    contact. ``work``, (2, nbody), is scratch space. For the other arguments see `write_margins`.
    """
    (_, tree, _, size, center, _), of = bodies, shapes[0]
    least, reach = work[0], work[1]
    for i in range(len(tree)):
        least[i] = np.inf
        reach[i] = timestep * _speed(i, 0, i, bodies, velocity) if tree[i] >= 0 else 0.0
    for g in range(len(of)):
        least[of[g]] = min(least[of[g]], geom_margin[g])
    for i in range(len(tree)):
        for j in range(i + 1, len(tree) if tree[i] >= 0 else 0):
            far = tree[j] >= 0 and reach[i] + reach[j] > least[i] + least[j]
            if far and _are_near(i, j, reach[i] + reach[j], size, center):
                way = timestep * _speed(i, j, i if size[i] < size[j] else j, bodies, velocity)
                if way > least[i] + least[j] and _are_near(i, j, way, size, center):
                    return True
    begin = 0
    while begin < len(tree):
        end, radius = _tree_at(begin, reach, bodies)
        far = False
        for i in range(begin, end):
            far = far or reach[i] > least[i]
        for g in range(len(of) if far else 0):
            if tree[of[g]] < 0 and _is_near(begin, radius, g, shapes, center):
                for i in range(begin, end):
                    far = reach[i] > least[i] + geom_margin[g]
                    if far and _is_near(i, size[i] + reach[i], g, shapes, center):
                        return True
        begin = end
    return False


@plain
def write_margins(
    body_margin, geom_margin, geom_gap, pair_margin, pair_gap, joint_margin, tendon_margin, bodies, shapes, velocity,
    led_to, surface_speed, timestep, gravity, work,
):  # fmt: skip
    """Write margins of bodies, geoms, pairs, joints and tendons, m or rad, for one step.

    MuJoCo adds up the margins of two geoms. For bodies that are near each other, the sum is `SLACK` times the distance
    by which they can approach each other in the step, but not more than what both move by. Which of the two has that
    margin is chosen such that few geoms meet: the fingers of a hand that swings move together, and would find each
    other from as far as they move if the margin for the floor were theirs. Slow bodies, and those of
    mechanisms of a few geoms, have the margin for all of their motion: finding some contacts in vain costs less than
    that choice. Limits of joints and tendons are always found; those that are far are left out by `rows.find_near`.

    Args:
        body_margin: margins of bodies, (nbody,), written.
        geom_margin: margins of geoms, (ngeom,), written.
        geom_gap: distance beyond the margins at which MuJoCo looks for contacts, m, (ngeom,); it is added to the
            margins, and set to 0.
        pair_margin: margins of pairs, (npair,), written.
        pair_gap: the same distance for pairs, m, (npair,).
        joint_margin: margins of limits of joints, (njnt,), written.
        tendon_margin: margins of limits of tendons, (ntendon,), written.
        bodies: root, the body on the world that carries each body; tree of each body, or -1 if it has no degrees of
            freedom; index of the mocap body that each body is, or -1; result of `write_sizes`; all (nbody,). Centers of
            mass of bodies and of their subtrees, (nbody, 3).
        shapes: body and MuJoCo's geom_type of each geom, (ngeom,), their positions, (ngeom, 3), and frames, (ngeom, 9),
            and geom_aabb, (ngeom, 6).
        velocity: MuJoCo's cvel, about the center of mass of the tree, (nbody, 6).
        led_to: cvel for the velocity to which forces lead without contact, (nbody, 6).
        surface_speed: speed of the fastest point of mocap bodies, m/s.
        timestep: h, s.
        gravity: magnitude of gravity, m/s^2.
        work: scratch space, (5, nbody).
    """
    (_, tree, _, size, center, _), of, (alone, many, _, _, _) = bodies, shapes[0], work
    motion = velocity, led_to, surface_speed, timestep, SLACK * timestep * timestep * gravity + LEAST
    work[:], far, some, still = 0.0, 0.0, False, 0.0
    for g in range(len(of)):
        if tree[of[g]] >= 0:
            many[of[g]] += 1.0
    most = of_tree = 0.0
    for i in range(1, len(tree)):
        of_tree = many[i] + (of_tree if tree[i] == tree[i - 1] else 0.0)
        most = max(most, of_tree)
    slow = np.inf if most < _FEW else _SLOW
    for i in range(len(tree)):
        body_margin[i] = 0.0
        if tree[i] >= 0:
            alone[i] = _way(i, 0, bodies, motion)
            is_fast = alone[i] > slow * size[i]
            body_margin[i] = 0.0 if is_fast else alone[i]
            far, some = max(far, alone[i]), some or is_fast
    if some:
        still = _reach_what_stands(body_margin, bodies, shapes, motion, work)
    for i in range(len(tree) if some else 0):
        for j in range(i + 1, len(tree) if many[i] > 0.0 else 0):
            if _may_lack(i, j, body_margin, bodies, work):
                way = _sum_of_margins(i, j, alone, bodies, motion)
                lacking = way - body_margin[i] - body_margin[j]
                if lacking > 0.0 and _are_near(i, j, way, size, center):
                    body_margin[i if _is_cheaper(i, j, work) else j] += lacking
    for i in range(len(tree)):
        if tree[i] < 0:
            body_margin[i] = still
    for i in range(len(geom_margin)):
        geom_margin[i], geom_gap[i] = body_margin[of[i]] + geom_gap[i], 0.0
    for i in range(len(geom_margin)):
        body_margin[of[i]] = max(body_margin[of[i]], geom_margin[i])
    for i in range(len(pair_margin)):
        pair_margin[i], pair_gap[i] = 2.0 * far + pair_gap[i], 0.0
    joint_margin[:] = ALWAYS
    tendon_margin[:] = ALWAYS


@plain
def _way(i, j, bodies, motion):
    """Return `SLACK` times the distance by which body i and body j, if it moves, can approach each other in a step."""
    (root, tree, mocap, size, _, _), (velocity, led_to, surface_speed, timestep, least) = bodies, motion
    at = j if tree[j] >= 0 and size[j] < size[i] else i
    speed = max(_speed(i, j, at, bodies, velocity), _speed(i, j, at, bodies, led_to))
    if tree[j] < 0 or mocap[root[i]] >= 0 or mocap[root[j]] >= 0:
        speed += surface_speed
    return SLACK * timestep * speed + least


@plain
def _sum_of_margins(i, j, alone, bodies, motion):
    """Return the sum of the margins that two bodies need."""
    return min(_way(i, j, bodies, motion), alone[i] + alone[j])


@plain
def _may_lack(i, j, body_margin, bodies, work):
    """Return whether the margins of two bodies may be too small for each other."""
    alone, many = work[0], work[1]
    lacks = many[j] > 0.0 and alone[i] + alone[j] > body_margin[i] + body_margin[j]
    return lacks and _are_near(i, j, alone[i] + alone[j], bodies[3], bodies[4])


@plain
def _is_cheaper(i, j, work):
    """Return whether the margin of body i meets fewer pairs of geoms than that of body j, for what both have to reach.

    The margin of the palm serves all fingers, and that of a finger meets all other ones.
    """
    many, met, served = work[1], work[2], work[3]
    return many[i] * met[i] * served[j] < many[j] * met[j] * served[i]


@plain
def _reach_what_stands(body_margin, bodies, shapes, motion, work):
    """Write margins with which fast bodies find geoms that do not move, and what `_is_cheaper` reads.

    Return the margin of geoms that do not move: they, too, take it where that is cheaper.
    """
    (_, tree, _, size, center, _), of, (alone, many, met, served, need) = bodies, shapes[0], work
    begin, still = 0, 0.0
    while begin < len(tree):
        end, radius = _tree_at(begin, alone, bodies)
        for g in range(len(of) if tree[begin] >= 0 else 0):
            if tree[of[g]] < 0 and _is_near(begin, radius, g, shapes, center):
                for i in range(begin, end):
                    if many[i] > 0.0 and body_margin[i] == 0.0 and _is_near(i, size[i] + alone[i], g, shapes, center):
                        need[i], met[i], met[0] = alone[i], met[i] + 1.0, met[0] + many[i]
        begin = end
    for i in range(len(tree)):
        served[0], served[i] = served[0] + need[i], served[i] + need[i]
        for j in range(i + 1, len(tree) if many[i] > 0.0 else 0):
            if _may_lack(i, j, body_margin, bodies, work):
                way = _sum_of_margins(i, j, alone, bodies, motion)
                if _are_near(i, j, way, size, center):
                    met[i], met[j] = met[i] + many[j], met[j] + many[i]
                    served[i], served[j] = served[i] + way, served[j] + way
    many[0] = 1.0
    for i in range(1, len(tree)):
        if need[i] > still and _is_cheaper(0, i, work):
            still = need[i]
    many[0] = 0.0
    for i in range(len(tree)):
        body_margin[i] = max(body_margin[i], need[i] - still)
    return still


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
