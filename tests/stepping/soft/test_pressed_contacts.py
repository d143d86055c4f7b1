"""Forces press light links into their limits: they bounce as limits close, and then MuJoCo's springs balance them."""

import mujoco
import pytest
from scenes import INTEGRATORS, compiled

from impactlaw import Moreau, Stepper

LINK = """<body pos="0 0 1"><joint name="link" type="slide" axis="1 0 0" range="-.01 .01" limited="true"/>
    <geom name="link" size=".1" mass="1e-2" contype="0" conaffinity="0"/></body>"""


FINGER = """<body pos="0 0 1"><joint axis="0 1 0" range="-60 20" limited="true"/>
    <geom type="capsule" fromto="0 0 0 .03 0 0" size=".006" mass=".02" contype="0" conaffinity="0"/>
    <body pos=".03 0 0"><joint axis="0 1 0" range="-60 20" limited="true"/>
    <geom type="capsule" fromto="0 0 0 .03 0 0" size=".006" mass=".005" contype="0" conaffinity="0"/></body></body>"""


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_pressed_limits_collide_as_they_close(e, integrator, code):
    """Torques close both limits by far more than `rest_speed` in a timestep; they end as deep as in `mj_step`."""
    model, data = compiled(FINGER, option=f'timestep="2e-3" gravity="0 0 0" integrator="{integrator}"')
    reference, collisions = mujoco.MjData(model), []
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=code)
    data.qfrc_applied[:] = reference.qfrc_applied[:] = 0.3
    for _ in range(600):
        stepper.step(data)
        mujoco.mj_step(model, reference)
        collisions.append(stepper.sums.collisions)
    assert 2 <= sum(collisions) <= 30
    assert sum(collisions[300:]) == 0
    assert data.qpos == pytest.approx(reference.qpos, abs=1e-6)


@pytest.mark.parametrize("code", ["auto", "never"])
def test_a_pressed_contact_takes_part_in_collisions_of_others(code):
    """A block that a force presses to a wall is hit by another of the same mass, which leaves at e times its speed."""
    world = """<geom name="wall" type="plane" size="9 9 1" zaxis="1 0 0"/>
        <body pos=".1 0 0"><joint type="slide" axis="1 0 0"/><geom name="a" size=".1" mass="1"/></body>
        <body pos=".5 0 0"><joint type="slide" axis="1 0 0"/><geom name="b" size=".1" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"')
    stepper, told = Stepper(model, Moreau(0.5), contact_model="soft", compiled=code), []
    data.qfrc_applied[0] = -200.0
    for i in range(400):
        if i == 300:
            data.qvel[1] = -4.0
        before = data.qvel[1]
        stepper.step(data)
        if i >= 300 and stepper.sums.collisions:
            told.append((len(stepper.events[0].contacts), stepper.events[0].impact.post_velocity[1] / before))
    assert told[0] == (2, pytest.approx(-0.5, abs=1e-6))


@pytest.mark.parametrize("code", ["auto", "never"])
def test_contacts_of_any_depth_collide_in_the_first_step(code):
    model, data = compiled(LINK, option='timestep="2e-3" gravity="0 0 0"')
    data.qpos[0], data.qvel[0] = 0.03, 1.0
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=code)
    stepper.step(data)
    assert stepper.events[0].impact.post_velocity[0] == pytest.approx(-0.5, abs=1e-12)


BATON = """<geom name="floor" type="plane" size="9 9 1"/>
    <body pos="0 0 .3075"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
    <geom name="tip" pos="0 0 -.3" size=".02" mass=".5"/><geom pos="0 0 .3" size=".02" mass=".5"/></body>"""


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_the_tip_of_a_body_that_turns_fast_collides_as_it_closes(e, integrator, code):
    """A falling baton turns by 0.25 in a step: its tip is then 12 mm deep, but closes by less than 4 mm a step."""
    model, data = compiled(BATON, option=f'timestep="1e-2" integrator="{integrator}"')
    data.qpos[1], data.qvel[1] = 0.29, -25.0
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=code)
    stepper.step(data)
    assert bool(stepper.events) == (integrator == "RK4")  # whose collisions are at the ends of steps
    if not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    before, after = event.impact.collision.pre_contact_velocity, event.impact.post_contact_velocity
    assert event.contacts.labels == ("floor/tip",)
    assert -0.45 < before[0] < -0.35
    assert after == pytest.approx(-e * before, abs=1e-12)
