"""Contacts are detected as far as geoms can approach each other, not as far as they can move together."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau
from impactlaw.compiled import compiled as compile_function
from impactlaw.compiled import for_python
from impactlaw.stepping.compiled.layout import structure_at, table
from impactlaw.stepping.time_stepping.compiled.margins import find_sizes, outruns, write_margins
from impactlaw.stepping.time_stepping.compiled.state.world import World
from impactlaw.stepping.time_stepping.tolerances import SLACK

H = 1e-3


@compile_function()
def _write_margins(w, velocity, led_to, room):
    write_margins(w, velocity, led_to, room)


def branches(rng, many, name, root):
    """Return a body with its own joint and children at random places, ``many`` bodies in all."""
    xml, left = [], many
    turn = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
    place = " ".join(f"{x:.3f}" for x in rng.uniform(-0.15, 0.15, 3))
    joint = root or f'<joint type="{rng.choice(["hinge", "slide"])}" axis="{turn}"/>'
    shape = rng.choice(['type="sphere" size=".04"', 'type="capsule" size=".03 .05"'])
    while left > 1:
        part = int(rng.integers(1, left))
        xml.append(branches(rng, part, f"{name}{left}", ""))
        left -= part
    return f'<body name="{name}" pos="{place}">{joint}<geom {shape} euler="{turn}"/>{"".join(xml)}</body>'


def scene(rng, trees, root):
    """Return trees of bodies near a floor, a wall and a ball on a mocap body at rest."""
    world = "".join(branches(rng, 7, f"t{i}", root) for i in range(trees))
    world += FLOOR + '<body pos=".3 0 .2"><geom type="box" size=".05 .5 .5"/></body>'
    world += '<body mocap="true" pos="-.3 0 .1"><geom size=".1"/></body>'
    model, data = compiled(world, option=f'timestep="{H}"')
    model.qpos0[:] += rng.normal(size=model.nq) * 0.05
    data.qpos[:] = model.qpos0
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:] = rng.normal(size=model.nv)
    if rng.random() < 0.7:  # the whole tree is fast
        data.qvel[:6] += 5.0 * rng.normal(size=6)
    return model, data


def reached(model, data, led_to):
    """Set margins in the model for one step; return the sizes of bodies."""
    sizes = np.zeros(model.nbody + model.nmocap)
    w = world(model, data, sizes)
    for_python(find_sizes)(w, 0)
    _write_margins(w, data.cvel.copy(), led_to, np.zeros(5 * model.nbody))
    return sizes


def world(model, data, sizes):
    """Return the scene as compiled code sees it; its mocap bodies do not move."""
    at = structure_at(model), structure_at(data), 0, table().ctypes.data, 0, sizes.ctypes.data, 0
    return World(*at, model.nv, H, False, 0, 0, 0)


def velocities_of_bodies(model, data, qvel):
    """Return MuJoCo's cvel at another velocity."""
    kept = data.qvel.copy()
    data.qvel[:] = qvel
    mujoco.mj_comVel(model, data)
    found = data.cvel.copy()
    data.qvel[:] = kept
    mujoco.mj_comVel(model, data)
    return found


def fastest_approaches(rng, model, data, cvel):
    """Return the largest approach speed of two geoms over random points, m/s, (ngeom, ngeom)."""
    points, most = 20, np.zeros((model.ngeom, model.ngeom))
    for _ in range(points):
        way = rng.normal(size=(model.ngeom, 3))
        at = data.geom_xpos + way / np.linalg.norm(way, axis=1)[:, None] * model.geom_rbound[:, None]
        twist = cvel[model.geom_bodyid]
        about = data.subtree_com[model.body_rootid[model.geom_bodyid]]
        speed = twist[:, 3:] + np.cross(twist[:, :3], at - about)
        apart = at[:, None] - at[None]
        normal = apart / np.maximum(np.linalg.norm(apart, axis=2), 1e-12)[..., None]
        most = np.maximum(most, -np.einsum("abk,abk->ab", normal, speed[:, None] - speed[None]))
    return most


def distances(model, data):
    """Return the distances of geoms, m, (ngeom, ngeom)."""
    apart = np.zeros((model.ngeom, model.ngeom))
    for one in range(model.ngeom):
        for other in range(one):
            apart[one, other] = apart[other, one] = mujoco.mj_geomDistance(model, data, one, other, 1.0, None)
    return apart


def pairs_that_may_meet(model, apart, approach):
    """Return which geoms are as near as they approach, and are not parent and child, bool (ngeom, ngeom)."""
    body = model.geom_bodyid
    tree, parent = model.body_treeid[body], model.body_parentid[body]
    kin = (body[:, None] == parent[None]) | (parent[:, None] == body[None]) | (body[:, None] == body[None])
    still = (tree[:, None] < 0) & (tree[None] < 0)
    return ~still & ~(kin & (tree[:, None] >= 0) & (tree[None] >= 0)) & (apart < approach)


ROOTS = {"free": "<freejoint/>", "fixed": '<joint axis="0 1 0"/>'}


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize("trees", [1, 2])
def test_no_two_geoms_come_to_each_other_from_farther_than_their_margins(trees, root):
    rng = np.random.default_rng(trees)
    for _ in range(60):
        model, data = scene(rng, trees, ROOTS[root])
        mujoco.mj_forward(model, data)
        cvel = velocities_of_bodies(model, data, data.qvel)
        led_to = velocities_of_bodies(model, data, data.qvel + rng.normal(size=model.nv))
        sizes, apart = reached(model, data, led_to), distances(model, data)
        far = model.geom_margin[:, None] + model.geom_margin[None]
        for velocity in (cvel, led_to):
            approach = SLACK * H * fastest_approaches(rng, model, data, velocity)
            assert (approach <= far)[pairs_that_may_meet(model, apart, approach)].all()
        for scale in (0.3, 1.0, 3.0):  # a collision can cause any velocity
            after = velocities_of_bodies(model, data, scale * rng.permutation(data.qvel))
            data.cvel[:] = after
            if not for_python(outruns)(world(model, data, sizes), np.zeros(2 * model.nbody)):
                approach = H * fastest_approaches(rng, model, data, after)
                assert (approach <= far)[pairs_that_may_meet(model, apart, approach)].all()


@pytest.mark.parametrize("trees", [1, 2])
def test_what_meets_within_a_step_is_found_at_its_start(trees):
    rng, met = np.random.default_rng(trees), 0
    for _ in range(150):
        model, data = scene(rng, trees, ROOTS["free"])
        data.qvel *= 4.0
        mujoco.mj_forward(model, data)
        before = {tuple(sorted(pair)) for pair in data.contact.geom[data.contact.dist < 0.0].tolist()}
        exact = mujoco.MjData(model)
        exact.qpos[:] = data.qpos
        mujoco.mj_integratePos(model, exact.qpos, data.qvel, H)
        mujoco.mj_fwdPosition(model, exact)
        after = {tuple(sorted(pair)) for pair in exact.contact.geom[exact.contact.dist < 0.0].tolist()} - before
        reached(model, data, data.cvel.copy())
        mujoco.mj_fwdPosition(model, data)
        assert after <= {tuple(sorted(pair)) for pair in data.contact.geom.tolist()}
        met += len(after)
    assert met > 20


def test_a_robot_that_falls_fast_finds_no_contacts_between_its_own_parts():
    """Parts 3 mm apart fall at 5 m/s, which is 5 mm per step, and turn together."""
    parts = "".join(
        f'<body pos="{0.043 * (i + 1)} 0 0"><joint axis="0 0 1" damping="1"/><geom size=".02"/></body>'
        for i in range(0, 8)
    )
    world = f'<body name="palm" pos="0 0 9"><freejoint/><geom size=".02" mass="5"/>{parts}</body>'
    model, data = compiled(world + FLOOR, option=f'timestep="{H}"')
    data.qvel[:6] = 0.0, 0.0, -5.0, 0.0, 0.0, 3.0
    stepper = stepping(model, Moreau(0.5))
    for _ in range(20):
        stepper.step(data)
        assert data.ncon == 0


def hand(side):
    """Return an arm of 0.6 m with a hand of 30 fingers that are 5 mm apart."""
    fingers = "".join(
        f'<body pos="{0.025 * (i % 6)} {0.025 * (i // 6)} 0"><joint axis="1 0 0" damping="1"/><geom size=".01"/></body>'
        for i in range(30)
    )
    arm = f'<joint axis="0 0 1"/><geom type="capsule" fromto="0 0 .1 {side * 0.5} 0 .1" size=".03"/>'
    return f'<body pos="{side * 0.2} 0 0">{arm}<body pos="{side * 0.6} 0 0">{fingers}</body></body>'


def test_fingers_of_two_hands_that_swing_find_the_wall_but_not_each_other():
    """Hands swing against each other at 12 m/s, which is 12 mm per step, on a body that stays where it is."""
    wall = '<geom name="wall" type="box" size=".2 .01 .2" pos=".8 .25 0"/>'
    world = f'<body><joint type="slide"/><geom size=".05" mass="1e3"/>{hand(1)}{hand(-1)}</body>{wall}'
    model, data = compiled(world, option=f'timestep="{H}" gravity="0 0 0"')
    data.qvel[[1, 32]] = 20.0, -20.0
    stepper = stepping(model, Moreau(0.5))
    for _ in range(8):
        stepper.step(data)
    assert data.maxuse_con == 0
    stepper.step(data)
    assert stepper.sums.collisions == 1
    assert data.maxuse_con < 12


def test_a_part_that_the_floor_throws_hits_its_neighbour():
    """A finger lands at 5 m/s with its palm 4 mm above it: thrown back, it stops the palm within the same step.

    Before the collision there is no relative motion, so that their contact is only found after the floor has thrown the
    finger.
    """
    finger = '<body pos="0 0 -.044"><joint type="slide" axis="0 0 1"/><geom name="tip" size=".02" mass="1"/></body>'
    palm = f'<body pos="0 0 .0661"><joint type="slide" axis="0 0 1"/><geom name="palm" size=".02" mass="1"/>{finger}'
    model, data = compiled(palm + "</body>" + FLOOR, '<option><flag filterparent="disable"/></option>')
    data.qvel[:] = -5.0, 0.0
    stepper = stepping(model, Moreau(1.0))
    labels = set()
    for _ in range(2):
        stepper.step(data)
        labels |= {label for event in stepper.events for label in event.contacts.labels}
        mujoco.mj_kinematics(model, data)
        assert data.geom_xpos[1, 2] - data.geom_xpos[2, 2] > 0.04 - 1e-5
    assert "palm/tip" in labels
