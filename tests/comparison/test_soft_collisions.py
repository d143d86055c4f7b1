"""Collisions of MuJoCo's own contacts, read from the states just before and just after contact."""

import math

import mujoco
import pytest

from impactlaw.comparison.soft_collisions import SoftCollisions

BALL = """<mujoco><option timestep="0.001"/><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body><joint type="slide" axis="0 0 1"/><geom name="ball" size="0.1"/></body></worldbody></mujoco>"""
G = 9.81


@pytest.mark.parametrize("before", [-2.0, -0.002, 0.0, 0.002])
@pytest.mark.parametrize("after", [1.0, 0.002, 0.0, -0.002])
def test_velocities_are_those_when_the_gap_closes_and_when_it_opens(before, after):
    """Also those of a ball that turns between a state and the contact: it rises, falls and hits, or opens and falls."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data, collisions, gap = mujoco.MjData(model), SoftCollisions(model), 1e-6
    for step, (height, velocity) in enumerate([(gap, before), (-1e-4, 0.0), (2 * gap, after)]):
        data.time, data.qpos[0], data.qvel[0] = 1e-3 * step, 0.1 + height, velocity
        events = collisions.look(data)
        assert len(events) == (step == 2)
    impact = events[0].impact
    assert impact.collision.pre_velocity[0] == pytest.approx(-math.sqrt(before**2 + 2 * G * gap), rel=1e-9)
    assert impact.post_velocity[0] == pytest.approx(math.sqrt(after**2 + 4 * G * gap), rel=1e-9)
    assert events[0].time == pytest.approx((before - impact.collision.pre_velocity[0]) / G, abs=1e-12)
    assert impact.violations.kinematic == 0.0


def test_a_ball_at_rest_on_the_floor_that_sinks_in_does_not_collide():
    model = mujoco.MjModel.from_xml_string(BALL)
    data, collisions = mujoco.MjData(model), SoftCollisions(model)
    for step, (height, velocity) in enumerate([(1e-16, 0.0), (-1e-4, 0.0), (1e-6, 0.1)]):
        data.time, data.qpos[0], data.qvel[0] = 1e-3 * step, 0.1 + height, velocity
        assert collisions.look(data) == ()
