"""How far collision detection has to reach: as far as each body and joint can move until the next detection."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, kernel, norm, plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, length, minus, plus, row
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_floats,
    model_floats,
    model_ints,
    offset,
    shapes_of,
    size,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, floats, ints
from impactlaw.stepping.time_stepping.compiled.state.kinds import NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surface_speed
from impactlaw.stepping.time_stepping.tolerances import ALWAYS, LEAST, SLACK

_MOST = mujoco.mjMAXCONPAIR
"""Largest number of contacts that MuJoCo finds between two geoms."""
_FEW = 48
"""Number of geoms of a tree of bodies below which finding some in vain costs less than the choice of margins."""
_SLOW = 0.015
"""Reach of a body, as a part of its size, up to which its margin alone covers it."""
_TWISTS = types.float64[:, ::1]
_PLANE, _FIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)


@plain
def find_sizes(w, carriers):
    """Write `world.World.sizes`.

    The size of a body is the largest distance of a point of its geoms from its center of mass, m; planes and height
    fields are left out. The reach of a mocap body is how far geoms that it carries reach from it, m.

    Args:
        w: the world.
        carriers: address of the mocap body that carries each geom, see `moving_surfaces.Surfaces`, int32 (ngeom,).
    """
    nbody, ngeom = size(w, MODEL.nbody), size(w, MODEL.ngeom)
    kind, body_of_geom = model_ints(w, MODEL.geom_type, ngeom), model_ints(w, MODEL.geom_bodyid, ngeom)
    position, bound = model_floats(w, MODEL.geom_pos, (ngeom, 3)), model_floats(w, MODEL.geom_rbound, ngeom)
    center, place = model_floats(w, MODEL.body_ipos, (nbody, 3)), model_floats(w, MODEL.body_pos, (nbody, 3))
    parent, mocap = model_ints(w, MODEL.body_parentid, nbody), model_ints(w, MODEL.body_mocapid, nbody)
    sizes, carrier = floats(w.sizes, nbody + size(w, MODEL.nmocap)), ints(carriers, ngeom)
    clear(sizes)
    for i in range(ngeom):
        body = body_of_geom[i]
        if kind[i] != _PLANE and kind[i] != _FIELD:
            sizes[body] = max(sizes[body], bound[i] + length(minus(row(position, i), row(center, body))))
        if w.surfaces != 0 and carrier[i] >= 0:
            reach = bound[i] + length(row(position, i))
            while mocap[body] < 0:
                reach, body = reach + length(row(place, body)), parent[body]
            sizes[nbody + carrier[i]] = max(sizes[nbody + carrier[i]], reach)


@kernel
def _places(w):
    """Return what is known of bodies and of shapes.

    Of bodies these are the body on the world that carries each of them, its tree, or -1 if it has no degrees of
    freedom, the mocap body that it is, or -1, its size, and centers of mass of bodies and of their subtrees; of shapes
    their body, MuJoCo's geom_type, geom_xpos, geom_xmat and geom_aabb.
    """
    nbody, (kind, _, place, turn) = size(w, MODEL.nbody), shapes_of(w)
    bodies = (
        model_ints(w, MODEL.body_rootid, nbody), model_ints(w, MODEL.body_treeid, nbody),
        model_ints(w, MODEL.body_mocapid, nbody), floats(w.sizes, nbody), data_floats(w, DATA.xipos, (nbody, 3)),
        data_floats(w, DATA.subtree_com, (nbody, 3)),
    )  # fmt: skip
    of, box = model_ints(w, MODEL.geom_bodyid, len(kind)), model_floats(w, MODEL.geom_aabb, (len(kind), 6))
    return bodies, (of, kind, place, turn, box)


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
def outruns(w, work):
    """Return whether a body can reach another one in a timestep from farther than contacts were looked for.

    The velocities of bodies in data must be those after contact. ``work``, (2 nbody,), is scratch space.
    """
    bodies, shapes = _places(w)
    (_, tree, _, size_of, center, _), of, timestep = bodies, shapes[0], w.timestep
    least, reach = work[: len(tree)], work[len(tree) : 2 * len(tree)]
    velocity, geom_margin = data_floats(w, DATA.cvel, (len(tree), 6)), model_floats(w, MODEL.geom_margin, len(of))
    for i in range(len(tree)):
        least[i] = np.inf
        reach[i] = timestep * _speed(i, 0, i, bodies, velocity) if tree[i] >= 0 else 0.0
    for g in range(len(of)):
        least[of[g]] = min(least[of[g]], geom_margin[g])
    for i in range(len(tree)):
        for j in range(i + 1, len(tree) if tree[i] >= 0 else 0):
            far = tree[j] >= 0 and reach[i] + reach[j] > least[i] + least[j]
            if far and _are_near(i, j, reach[i] + reach[j], size_of, center):
                way = timestep * _speed(i, j, i if size_of[i] < size_of[j] else j, bodies, velocity)
                if way > least[i] + least[j] and _are_near(i, j, way, size_of, center):
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
                    if far and _is_near(i, size_of[i] + reach[i], g, shapes, center):
                        return True
        begin = end
    return False


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


@linked(types.void(WORLD, _TWISTS, _TWISTS, NUMBERS), counts=False)
def write_margins(w, velocity, led_to, room):
    """Write margins of bodies, geoms, pairs, joints and tendons, m or rad, for one step.

    MuJoCo adds up the margins of two geoms. For bodies that are near each other, the sum is `SLACK` times the distance
    by which they can approach each other in the step, but not more than what both move by. Which of the two has that
    margin is chosen such that few geoms meet: the fingers of a hand that swings move together, and would find each
    other from as far as they move if the margin for the floor were theirs. Slow bodies, and those of
    mechanisms of a few geoms, have the margin for all of their motion: finding some contacts in vain costs less than
    that choice. Limits of joints and tendons are always found; those that are far are left out by `choose`. Gaps of
    geoms and pairs, beyond which MuJoCo looks for contacts, are added to margins, and set to 0.

    Args:
        w: the world.
        velocity: MuJoCo's cvel, about the center of mass of the tree, (nbody, 6).
        led_to: cvel for the velocity to which forces lead without contact, (nbody, 6).
        room: scratch space, (5 nbody,).
    """
    bodies, shapes = _places(w)
    (_, tree, _, size_of, center, _), of, npair = bodies, shapes[0], size(w, MODEL.npair)
    work, gravity = floats(address_of(room), (5, len(tree))), norm(floats(w.model + offset(w, MODEL.opt_gravity), 3))
    motion = velocity, led_to, surface_speed(w), w.timestep, SLACK * w.timestep * w.timestep * gravity + LEAST
    (alone, many, _, _, _), body_margin = work, model_floats(w, MODEL.body_margin, len(tree))
    geom_margin, geom_gap = model_floats(w, MODEL.geom_margin, len(of)), model_floats(w, MODEL.geom_gap, len(of))
    pair_margin, pair_gap = model_floats(w, MODEL.pair_margin, npair), model_floats(w, MODEL.pair_gap, npair)
    joint_margin = model_floats(w, MODEL.jnt_margin, size(w, MODEL.njnt))
    tendon_margin = model_floats(w, MODEL.tendon_margin, size(w, MODEL.ntendon))
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
            is_fast = alone[i] > slow * size_of[i]
            body_margin[i] = 0.0 if is_fast else alone[i]
            far, some = max(far, alone[i]), some or is_fast
    if some:
        still = _reach_what_stands(body_margin, bodies, shapes, motion, work)
    for i in range(len(tree) if some else 0):
        for j in range(i + 1, len(tree) if many[i] > 0.0 else 0):
            if _may_lack(i, j, body_margin, bodies, work):
                way = _sum_of_margins(i, j, alone, bodies, motion)
                lacking = way - body_margin[i] - body_margin[j]
                if lacking > 0.0 and _are_near(i, j, way, size_of, center):
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
def narrow(w, share):
    """Scale down the margins of geoms with more contacts with a height field than MuJoCo finds, `mjMAXCONPAIR`.

    MuJoCo goes through the prisms of the field by rows, and stops at that number: the nearest can be missing. Return
    whether there are such geoms. ``share`` is the factor.
    """
    n, geoms, found, many = size(w, MODEL.ngeom), contact_ints(w, CONTACT.geom, 2), False, 0
    shape, geom_margin = model_ints(w, MODEL.geom_type, n), model_floats(w, MODEL.geom_margin, n)
    pair_margin = model_floats(w, MODEL.pair_margin, size(w, MODEL.npair))
    for c in range(len(geoms)):
        one, other = geoms[c, 0], geoms[c, 1]
        many = many + 1 if c > 0 and one == geoms[c - 1, 0] and other == geoms[c - 1, 1] else 1
        if many == _MOST and min(one, other) >= 0 and (shape[one] == _FIELD or shape[other] == _FIELD):
            geom_margin[one], geom_margin[other] = share * geom_margin[one], share * geom_margin[other]
            found = True
    for i in range(len(pair_margin) if found else 0):
        pair_margin[i] *= share
    return found
