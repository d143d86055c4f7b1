"""Contacts with turning gradients persist and do not collide: ropes, falling legs, rolling disks, tables."""

import mujoco
import numpy as np
import pytest
from scenes import compiled, energy
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau, Poisson
from impactlaw.compiled import for_python
from impactlaw.solvers.cones import CONE
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_sliding, write_turns
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.problem.targets import aim
from impactlaw.stepping.time_stepping.tolerances import RESOLVED, REST_SPEED

BOB = '<site name="hook"/><body pos="0 0 -1"><freejoint/><geom size=".05" mass="1"/><site name="bob"/></body>'
ROPE = """<tendon><spatial limited="true" range="0 1"><site site="hook"/><site site="bob"/></spatial></tendon>"""
LEG = """<body pos="0 0 .5"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .02"/>
    <geom name="foot" size="1e-4" pos="0 0 -.4999"/></body>"""


def energies(model, data, law, seconds):
    """Return the change of energy after each step, J, and the number of steps with a collision."""
    stepper, found, collisions = stepping(model, law), [energy(model, data)], 0
    for _ in range(round(seconds / model.opt.timestep)):
        stepper.step(data)
        collisions += bool(stepper.events)
        found.append(energy(model, data))
    return np.subtract(found[1:], found[0]), collisions


@pytest.mark.parametrize("law", [Moreau(0.0), Moreau(0.5), Poisson(0.5)], ids=str)
def test_a_bob_on_a_taut_rope_keeps_its_energy(law):
    """It closes the rope by 9 h m/s in every step, which is not a collision: the loss is of second order."""
    losses = []
    for timestep in (4e-3, 2e-3, 1e-3):
        model, data = compiled(BOB, ROPE, option=f'timestep="{timestep}"')
        data.qvel[0] = 3.0
        change, collisions = energies(model, data, law, 2.0)
        losses.append(-change[-1])
        assert collisions <= 8
        assert change.max() < 1e-9
    assert losses[2] < 1.6e-4  # J of 4.5
    assert losses[1] < 0.4 * losses[0]
    assert losses[2] < 0.4 * losses[1]


def test_a_leg_that_falls_over_gains_no_energy():
    """Its foot sticks while its gradient turns: energy gain and creep of the foot are of second order."""
    gains, places = [], []
    for timestep in (4e-3, 2e-3, 1e-3):
        model, data = compiled(FLOOR + LEG, option=f'timestep="{timestep}"', geom='friction="1.5 0 0"')
        data.qvel[3:6] = 1.2, 1.6, 0.0
        data.qvel[:3] = np.cross(data.qvel[3:6], [0, 0, 0.5])
        change, collisions = energies(model, data, Moreau(0.5), 0.3)
        assert collisions == 0
        gains.append(np.abs(change).max())
        places.append(data.geom("foot").xpos[:2].copy())
    assert gains[2] < 1e-5
    assert gains[2] < 0.3 * gains[1] < 0.09 * gains[0]
    longer, shorter = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert shorter < 0.3 * longer < 1e-5


def test_a_disk_that_rolls_on_its_edge_does_not_collide():
    """Euler's disk. Regression: by its own collisions it lost 14 % of its energy per second."""
    radius, half, tilt = 0.1, 0.002, np.radians(20)
    disk = f'<body><freejoint/><geom type="cylinder" size="{radius} {half}" mass=".4"/></body>'
    model, data = compiled(FLOOR + disk, option='timestep="1e-3"', geom='friction="1 0 0"')
    mujoco.mju_axisAngle2Quat(data.qpos[3:7], np.array([0.0, 1.0, 0.0]), tilt)
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, data.qpos[3:7])
    axes = frame.reshape(3, 3)
    center = -axes @ [radius, 0, -half]
    spin = np.sqrt(4 * 9.81 / (radius * np.sin(tilt))) * (np.array([0, 0, 1]) - np.cos(tilt) * axes[:, 2])
    data.qpos[:3], data.qvel[:3], data.qvel[3:] = center, np.cross(spin, center), axes.T @ spin
    before = energy(model, data)
    change, collisions = energies(model, data, Moreau(0.0), 0.5)
    assert collisions <= 3
    assert np.abs(change).max() < 1e-3 * before


def test_a_table_that_accelerates_carries_a_body():
    """The body approaches the table by h a in every step, and has its velocity at the end of each."""
    world = """<body name="table" mocap="true"><geom type="box" size="1 1 .1" pos="0 0 -.1"/></body>
        <body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="1e-3"')
    stepper, collisions = stepping(model, Moreau(0.5)), 0
    for step in range(1, 201):
        data.mocap_pos[0, 2] = 10.0 * (step * 1e-3) ** 2
        stepper.step(data)
        collisions += bool(stepper.events)
        if step > 10:
            assert data.qvel[2] == pytest.approx(20.0 * data.time, abs=1e-9)
            assert data.qpos[2] - 0.1 == pytest.approx(data.mocap_pos[0, 2], abs=1e-5)
    assert collisions <= 3


def test_an_elastic_ball_joint_keeps_bouncing():
    """It has almost no inertia about its arm, and bounces off its limit of 1.2 degrees in every step."""
    arm = """<body><joint type="ball" limited="true" range="0 1.2"/>
        <geom pos="0 0 -1" size=".05" mass="1" contype="0" conaffinity="0"/></body>"""
    model, data = compiled(arm, option='timestep="1e-3"')
    data.qvel[:] = 5.0, 0.0, 3.0
    change, collisions = energies(model, data, Moreau(1.0), 0.5)
    assert collisions > 300
    assert np.abs(change).max() < 1e-3


@pytest.mark.parametrize("scene", ["joint", "tendon"])
@pytest.mark.parametrize("e", [1.0, 0.9])
def test_what_flies_from_limit_to_limit_in_a_step_collides(scene, e):
    """Each collision reverses the velocity as the one before does."""
    limit = 'limited="true" range="-5e-5 5e-5"'
    joint = limit if scene == "joint" else ""
    world = f'<body><joint name="x" type="slide" axis="1 0 0" {joint}/><geom size=".05" mass="1"/></body>'
    rest = f'<tendon><fixed {limit}><joint joint="x" coef="1"/></fixed></tendon>' if scene == "tendon" else ""
    model, data = compiled(world, rest, option='timestep="1e-3" gravity="0 0 0"')
    data.qvel[0] = 0.04
    stepper = stepping(model, Moreau(e))
    for _ in range(20):
        before = abs(data.qvel[0])
        stepper.step(data)
        speed = abs(data.qvel[0])
        assert speed == pytest.approx(before, abs=1e-9) or speed == pytest.approx(e * before, abs=1e-9)
    assert e == 1.0 or speed < 0.03


def _aim(gap, gamma, reached, turned):
    """Return whether a contact collides, and its target velocity, for e = 0.5."""
    groups, amounts, none = np.array([[0], [1], [CONE], [0]], np.int32), np.array([[gap], [0.0]]), np.zeros(1, np.int32)
    rates = np.array([1.0, gamma, gamma, 0.0, 0.0, reached, turned]).reshape(7, 1)
    rows = Rows(np.zeros((3, 1), np.int32), none, np.zeros(1), groups, np.zeros(1, np.int64), amounts, rates)
    found, which = np.empty(1), np.empty(1, bool)
    some = for_python(aim)(rows, 1e-3, 0.5, (REST_SPEED, REST_SPEED), RESOLVED, np.ones(1, bool), found, which)
    assert some == which[0]
    return some, found[0]


@pytest.mark.parametrize(
    ("gamma", "reached", "turned", "collides", "target"),
    [
        (-0.02, 0.02, -0.04, False, 0.02),  # persists
        (-0.03, 0.02, -0.05, False, 0.025),  # the same, and minus half of the turn
        (-0.01, 0.03, -0.04, False, 0.01),  # not more than elastic, so that no energy is created
        (-0.045, -0.01, -0.035, False, 0.0225),  # not less than e, so that an elastic contact conserves energy
        (-0.02, np.nan, np.nan, True, 0.01),  # no impulse in the previous step: e = 0.5
        (-0.02, 0.0, np.nan, True, 0.01),  # an impulse in the previous step alone
        (-0.02, 0.02, -0.02, True, 0.01),  # an edge: a sudden turn
        (-0.09, 0.09, -0.18, True, 0.045),  # so fast that it always collides
        (0.02, -0.02, 0.04, False, 0.0),  # opens
    ],
)
def test_what_turns_as_in_the_step_before_goes_on(gamma, reached, turned, collides, target):
    assert _aim(0.0, gamma, reached, turned) == (collides, pytest.approx(target, abs=1e-15))


@pytest.mark.parametrize(("gap", "collides", "target"), [(3e-6, False, 0.02 - 3e-3), (5e-6, True, 0.01)])
def test_what_goes_on_is_closed(gap, collides, target):
    """Its gap is closed if it is up to a tenth of h d."""
    assert _aim(gap, -0.02, 0.02, -0.04) == (collides, pytest.approx(target, abs=1e-15))


def test_a_block_that_slides_to_rest_does_not_turn_back():
    """A friction force at its limit stores no turn: a sliding contact is not a turning one."""
    block = '<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
    model, data = compiled(FLOOR + block, option='timestep="1e-3"', geom='friction=".3 0 0"')
    data.qvel[0] = 0.04
    stepper, speeds = stepping(model, Moreau(0.0)), []
    for _ in range(40):
        stepper.step(data)
        speeds.append(data.qvel[0])
    assert min(speeds) > -1e-12
    assert speeds[9] == pytest.approx(0.04 - 0.3 * 9.81 * 0.01, abs=1e-9)
    assert abs(speeds[-1]) < 1e-12


@pytest.mark.parametrize(
    ("now", "turned", "aimed"),
    [
        (0.01, 0.02, True),  # t = -0.01, d = 0.02 as in the step before
        (0.01, 0.03, None),  # another turn
        (0.01, np.nan, None),  # no turn yet
        (0.08, 0.09, None),  # too fast
    ],
)
def test_what_sticks_aims_at_minus_half_of_its_turn(now, turned, aimed):
    groups = np.array([[0], [2], [CONE], [0]], np.int32)
    rates = np.ones((7, 2))
    rates[1], rates[5], rates[6] = [0.0, now], [0.0, -0.01], [0.0, turned]
    sliding = np.zeros(2)
    for_python(write_sliding)(groups, rates, RESOLVED, sliding)
    assert sliding == pytest.approx([0.0, -0.0 if aimed is None else -0.5 * (now + 0.01)], abs=1e-15)


def test_what_is_remembered_of_a_contact():
    """For sticking contacts the whole target is stored; for sliding ones the normal velocity; for open ones NaN.

    The last one is not loaded, and is where others hold it.
    """
    first = np.arange(0, 8, 2)
    groups = np.array([first, [2] * 4, [CONE] * 4, np.arange(4)], np.int32)
    x, rates, aims = np.zeros(8), np.ones((7, 8)), np.zeros(8)
    x[:4], aims[1::2] = [1.0, 0.5, 1.0, 1.0], [0.4, 0.5, 0.6, 1.0]
    rates[1], rates[5] = np.arange(8.0), 0.5
    sparse, gaps = np.zeros((3, 8), np.int32), np.array([[0.0, 0.0, 1e-3, 0.0], [0.0] * 4])
    rows = Rows(sparse, np.zeros(0, np.int32), np.zeros(0), groups, np.arange(4), gaps, rates)
    for_python(write_turns)(rows, x, np.array([0.1, 0.2, 0.3, 0.4]), aims, np.zeros(0))
    np.testing.assert_array_equal(rates[5], [0.1, 0.4, 0.2, np.nan, np.nan, np.nan, np.nan, 1.0])
    np.testing.assert_array_equal(rates[6], np.arange(8.0) - 0.5)
