"""Overlap at the start of rigid stepping is removed by the smallest shift in the kinetic metric; exact answers."""

import mujoco
import numpy as np
import pytest
from stepping.event_driven.overlap.built import BALL, STATIC_LID, H, build, pushed, slider

from impactlaw import Moreau, Stepper

FLOOR = '<geom name="floor" type="plane" size="5 5 .1"/>'


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_ball_in_the_floor_moves_up_and_keeps_its_velocity(integrator):
    model, data = build(FLOOR + f'<body pos="0 0 .09"><freejoint/>{BALL}</body>', integrator=integrator)
    data.qvel[:] = 0.3, -0.2, 0.0, 0.0, 0.0, 0.5
    before = data.qvel.copy()
    pushed(model, data)
    np.testing.assert_allclose(data.qpos[:3], [0.3 * H, -0.2 * H, 0.1], atol=1e-11)
    np.testing.assert_allclose(data.qvel, before, atol=1e-12)
    assert data.time == H


def test_a_ball_that_approaches_collides_where_it_was_pushed_to():
    model, data = build(FLOOR + f'<body pos="0 0 .09"><freejoint/>{BALL}</body>')
    data.qvel[2] = -1.0
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    (event,) = stepper.events
    assert event.time == 0.0
    assert event.qpos[2] == pytest.approx(0.1, abs=1e-11)
    assert data.qpos[2] == pytest.approx(0.1 + 0.5 * H, abs=1e-11)


def test_a_gap_that_closes_in_the_same_step_is_located_from_where_it_was_pushed_to():
    model, data = build(FLOOR + STATIC_LID.format(z=0.301) + slider("ball", "0 0 .09", 1, axes=("0 0 1",)))
    data.qvel[0] = 1.0
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    (event,) = stepper.events
    assert event.time == pytest.approx(0.001, abs=1e-9)
    np.testing.assert_allclose(data.qpos, [0.01 + 0.001 - 0.5 * 0.001], atol=1e-9)


def test_a_box_in_a_corner_moves_out_of_all_three_faces_and_does_not_turn():
    walls = '<geom type="plane" size="5 5 .1" zaxis="1 0 0"/><geom type="plane" size="5 5 .1" zaxis="0 1 0"/>'
    box = '<body pos=".19 .27 .35"><freejoint/><geom type="box" size=".2 .3 .4"/></body>'
    model, data = build(FLOOR + walls + box)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.2, 0.3, 0.4, 1, 0, 0, 0], atol=1e-10)


def test_a_box_pressed_in_by_an_edge_lands_on_that_edge():
    """A box with one horizontal axis: shift z and angle put its lowest edge at height 0 at the least cost."""
    box = """<body pos="0 0 .26"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
             <geom type="box" size=".2 .3 .2" mass="1"/></body>"""
    model, data = build(FLOOR + box)
    inertia = 1.0 * (0.4**2 + 0.4**2) / 12
    data.qpos[1] = np.radians(30)
    pushed(model, data)
    z, angle = data.qpos

    def height(angle):  # height of the lowest edge minus that of the centre
        return -0.2 * np.sqrt(2.0) * np.cos(np.pi / 4 - angle)

    def slope(angle):
        return (height(angle + 1e-6) - height(angle - 1e-6)) / 2e-6

    turn = angle - np.radians(30)
    assert 0.26 + z + height(angle) == pytest.approx(0.0, abs=1e-9)
    assert inertia * turn == pytest.approx(z * slope(angle), rel=1e-6)  # the shift is along M^-1 J^T
    assert z > 0.005
    assert abs(turn) > 0.01


@pytest.mark.parametrize(("light", "heavy"), [(1.0, 1.0), (1.0, 3.0), (1e-6, 1e6)])
def test_two_balls_share_the_shift_by_mass(light, heavy):
    model, data = build(slider("a", "0 0 0", light) + slider("b", ".17 0 0", heavy))
    pushed(model, data)
    total = light + heavy
    np.testing.assert_allclose(data.qpos, [-0.03 * heavy / total, 0.03 * light / total], atol=1e-11)


def test_curved_surfaces_part_along_their_common_normal():
    plane = ("1 0 0", "0 0 1")
    model, data = build(slider("a", "0 0 0", 1, axes=plane) + slider("b", ".06 0 .08", 4, axes=plane))
    pushed(model, data)
    normal = np.array([0.6, 0.8])
    np.testing.assert_allclose(data.qpos, np.concatenate([-0.08 * normal, 0.02 * normal]), atol=1e-10)


def test_who_is_behind_is_pushed_along_and_a_wall_is_not():
    wall = '<geom type="plane" size="5 5 .1" pos="-.1 0 0" zaxis="1 0 0"/>'
    row = "".join(slider(name, f"{x} 0 0", 1) for name, x in (("a", 0.0), ("b", 0.15), ("c", 0.36)))
    model, data = build(wall + row)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.0, 0.05, 0.04], atol=1e-11)


def test_joints_beyond_their_limits_come_back_to_them():
    model, data = build(
        '<body><joint type="slide" axis="1 0 0" limited="true" range="-1 2"/><geom size=".1" mass="1"/></body>'
        '<body pos="0 9 0"><joint axis="0 1 0" limited="true" range="-30 45"/><geom size=".1" pos="1 0 0"/></body>'
    )
    data.qpos[:] = 2.25, np.radians(-31)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [2.0, np.radians(-30)], atol=1e-11)


def test_a_limit_between_two_bodies_keeps_their_center_of_mass():
    model, data = build(
        '<body><joint type="slide" axis="1 0 0"/><geom size=".1" mass="3"/><body pos="1 0 0">'
        '<joint type="slide" axis="1 0 0" limited="true" range="0 .5"/><geom size=".1" mass="1"/></body></body>'
    )
    data.qpos[:] = 0.0, 0.7
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.2 * 1 / 4, 0.5], atol=1e-11)


def test_a_tendon_beyond_its_limit_is_shared_by_its_joints():
    rest = (
        '<tendon><fixed limited="true" range="-1 1"><joint joint="a" coef="1"/>'
        '<joint joint="b" coef="2"/></fixed></tendon>'
    )
    body = '<body pos="0 {y} 0"><joint name="{n}" type="slide" axis="1 0 0"/><geom size=".1" mass="{m}"/></body>'
    model, data = build(body.format(y=0, n="a", m=1) + body.format(y=1, n="b", m=4), rest)
    data.qpos[:] = 1.0, 0.2
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [1.0 - 0.2, 0.2 - 0.1], atol=1e-11)  # d = -M^-1 (1, 2) 0.4 / (1 + 4/4)


def test_equality_constraints_hold_while_bodies_are_pushed():
    rest = '<equality><joint joint1="left" joint2="right"/></equality>'
    body = """<body pos="{x} 0 {z}"><joint name="{n}" type="slide" axis="0 0 1"/>
              <geom type="sphere" size=".1" mass="{m}"/></body>"""
    model, data = build(FLOOR + body.format(x=0, z=0.08, n="left", m=1) + body.format(x=1, z=0.3, n="right", m=5), rest)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.02, 0.02], atol=1e-9)


def test_rods_that_overlap_in_the_pin_that_joins_them_are_not_turned():
    """Watt's linkage of rods: no motion that the pin allows opens the overlap; only rounding leaves it a gradient."""
    rod = '<geom type="capsule" size="{size}" mass="1" fromto="0 0 0 {end}"/>'
    left = rod.format(size=0.06, end="2 1.5 0")
    middle = f'<body name="middle" pos="2 1.5 0"><joint axis="0 0 1"/>{rod.format(size=0.055, end="2 -.5 0")}</body>'
    right = rod.format(size=0.06, end="-2 1.5 0")
    world = f"""<body pos="-2.5 0 0"><joint axis="0 0 1" damping=".2"/>{left}{middle}</body>
                <body name="right" pos="2.5 0 0"><joint axis="0 0 1" damping=".2"/>{right}</body>"""
    rest = '<equality><connect body1="middle" body2="right" anchor="2 -.5 0"/></equality>'
    model, data = build(world, rest)
    mujoco.mj_forward(model, data)
    assert data.contact.dist.min() < -0.1
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    for _ in range(5):
        stepper.step(data)
    np.testing.assert_allclose(data.qpos, 0.0, atol=1e-3)
