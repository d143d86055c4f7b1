"""Equality constraints under time stepping: ropes, connected and welded bodies."""

import math

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.stepped import FLOOR, first_impact, stepping

from impactlaw import Moreau, Newton, Stepper

G = 9.81
MASSES = """<body pos="0 0 1.1"><joint name="down" type="slide" axis="0 0 1"/>
    <geom name="heavy" size=".1" mass="3"/></body>
    <body pos="1 0 3"><joint name="up" type="slide" axis="0 0 1"/><geom name="light" size=".1" mass="1"/></body>"""


@pytest.mark.parametrize("how", ["joint", "tendon"])
@pytest.mark.parametrize("timestep", [2e-3, 5e-4])
def test_two_masses_on_a_rope_hit_the_floor_together(how, timestep):
    """After 1 m at g / 2 all 4 kg stop and return: Lambda = 4 (1 + e) u, u = sqrt(g)."""
    rest = '<equality><joint joint1="up" joint2="down" polycoef="0 -1 0 0 0"/></equality>'
    if how == "tendon":
        both = '<joint joint="down" coef="1"/><joint joint="up" coef="1"/>'
        rest = f'<tendon><fixed name="rope">{both}</fixed></tendon><equality><tendon tendon1="rope"/></equality>'
    model, data = compiled(FLOOR + MASSES, rest, option=f'timestep="{timestep}"', geom='friction=".3"')
    before, event = first_impact(stepping(model, Newton(0.5)), data)
    u = math.sqrt(G)
    assert before == pytest.approx([-u, u], abs=G * timestep)  # two steps of g / 2
    assert event.impact.impulse == pytest.approx([4 * 1.5 * -before[0]], rel=1e-5)
    assert event.impact.impulse == pytest.approx([18.79], abs=6 * G * timestep)
    assert event.impact.post_velocity == pytest.approx([1.566, -1.566], abs=0.5 * G * timestep)
    assert data.qvel[0] == pytest.approx(-0.5 * before[0], abs=1e-9)
    assert data.qvel[1] == pytest.approx(-data.qvel[0], abs=5e-3)  # MuJoCo's rope gives slightly between collisions


def test_a_connect_makes_a_pendulum_of_a_free_body():
    world = '<body name="bob" pos="1 0 0"><freejoint/><geom size=".05" mass="1"/></body>'
    model, data = compiled(world, '<equality><connect body1="bob" body2="world" anchor="-1 0 0"/></equality>')
    stepper = stepping(model, Moreau(0.5))
    for _ in range(300):
        stepper.step(data)
        rotated = np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, np.array([-1.0, 0, 0]), data.qpos[3:7])
        assert np.linalg.norm(data.qpos[:3] + rotated) < 2e-3
    reference = compiled('<body><joint axis="0 1 0"/><geom size=".05" pos="1 0 0" mass="1"/></body>')
    run(stepping(reference[0], Moreau(0.5)), reference[1], 300)
    angle = reference[1].qpos[0]
    assert data.qpos[[0, 2]] == pytest.approx([math.cos(angle), -math.sin(angle)], abs=5e-3)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_two_welded_boxes_bounce_as_one(e):
    bodies = "".join(
        f'<body name="{n}" pos="0 0 {z}"><freejoint/><geom name="{n}" type="box" size=".1 .1 .1" mass="{m}"/></body>'
        for n, z, m in (("low", 0.3, 1), ("high", 0.52, 3))
    )
    weld = '<equality><weld body1="low" body2="high"/></equality><contact><exclude body1="low" body2="high"/></contact>'
    model, data = compiled(FLOOR + bodies, weld)
    before, event = first_impact(stepping(model, Newton(e)), data)
    u = -before[2]
    assert data.qvel[2] == pytest.approx(e * u, abs=1e-9)
    assert data.qvel[8] == pytest.approx(e * u, abs=2e-2 * u)
    assert event.impact.impulse.sum() == pytest.approx(4 * (1 + e) * u, rel=2e-2)


def test_equality_constraints_that_are_off_hold_nothing():
    rest = '<equality><joint joint1="up" joint2="down" polycoef="0 -1 0 0 0"/></equality>'
    model, data = compiled(FLOOR + MASSES, rest)
    data.eq_active[0] = 0
    run(stepping(model, Newton(0.5)), data, 50)
    assert data.qvel == pytest.approx([-0.981, -0.981], abs=1e-9)
    data.eq_active[0] = 1
    run(stepping(model, Newton(0.5)), data, 200)
    assert data.qvel[0] == pytest.approx(-data.qvel[1], abs=0.05)


@pytest.mark.parametrize("pitch", [0.03, 0.05])
def test_a_screw_that_slips_a_little_bounces_with_its_spin(pitch):
    """MuJoCo's coupling slips by 1 and 2 % of the fall, but in the collision it acts as one mass m + I / p^2."""
    screw = """<body pos="0 0 .5"><joint name="z" type="slide" axis="0 0 1"/><joint name="turn" axis="0 0 1"/>
        <geom size=".1" mass="1" friction="0"/></body>"""
    rest = f'<equality><joint joint1="z" joint2="turn" polycoef="0 {pitch} 0 0 0"/></equality>'
    model, data = compiled(FLOOR + screw, rest, option='timestep="5e-4"', geom='friction="0" condim="1"')
    before, _ = first_impact(stepping(model, Moreau(0.5)), data)
    assert abs(before[0] - pitch * before[1]) > -0.01 * before[0]
    assert data.qvel[0] == pytest.approx(-0.5 * before[0], abs=1e-9)
    assert pitch * data.qvel[1] == pytest.approx(data.qvel[0], abs=-0.05 * before[0])


@pytest.mark.parametrize("diagonal", ["enable", "disable"])
def test_a_soft_constraint_is_as_soft_as_in_mujoco(diagonal):
    """MuJoCo scales softness by the diagonal of J M^-1 J^T, which is approximate unless the flag makes it exact."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001"><flag diagexact="{diagonal}"/></option><worldbody>{FLOOR}
        <body pos="0 0 2"><joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/>
          <body pos=".5 0 0"><joint name="b" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".04"/>
        </body></body></worldbody>
        <equality><joint joint1="a" joint2="b" solref=".1 1" solimp=".5 .5 .1"/></equality></mujoco>"""
    )
    data, expected = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(100):
        stepper.step(data)
        mujoco.mj_step(model, expected)
    assert data.qvel == pytest.approx(expected.qvel, abs=1e-4)
