"""Bodies do not overlap at the end of a step, even where gradients at its midpoint do not show it."""

from __future__ import annotations

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_DEPTH = 1e-5  # m


def _dropped(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a robot of gymnasium 5 cm above the ground."""
    env = gymnasium.make(name).unwrapped
    model = env.model  # type: ignore[attr-defined]
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = env.init_qpos, env.init_qvel  # type: ignore[attr-defined]
    data.qpos[2] += 0.05
    return model, data


def _depths(model: mujoco.MjModel, data: mujoco.MjData, stepper: Stepper, controls: np.ndarray) -> np.ndarray:
    """Return the depth of the overlap at the end of each step, m."""
    seen, depths = mujoco.MjData(model), np.zeros(len(controls))
    for step, data.ctrl[:] in enumerate(controls):
        stepper.step(data)
        seen.qpos[:] = data.qpos
        mujoco.mj_fwdPosition(model, seen)
        depths[step] = -seen.contact.dist.min(initial=0.0)
    return depths


@pytest.mark.parametrize(
    ("name", "restitution", "random"),
    [
        ("Humanoid-v5", 0.5, False),
        ("Ant-v5", 0.0, True),
        ("HumanoidStandup-v5", 0.5, True),
    ],
)
def test_robots_do_not_sink_in(name, restitution, random):
    """After the initial overlap has been opened, no contact is deeper than 1e-5 m."""
    model, data = _dropped(name)
    stepper = Stepper(model, Moreau(restitution), scheme="time-stepping")
    low, high = model.actuator_ctrlrange.T
    blocks = np.random.default_rng(0).uniform(low, high, (100, model.nu)) * random
    depths = _depths(model, data, stepper, np.repeat(blocks, 20, axis=0))
    assert depths[100:].max() <= _DEPTH


def _turning_leg() -> mujoco.MjModel:
    """Return a foot on a link that turns about a hip below a floor, and thereby pulls the foot down."""
    return mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><geom type="plane" size="5 5 1"/>
        <body pos="0 0 -.28"><joint type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body><joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
            <body pos=".3 0 .33"><joint axis="0 1 0"/><geom type="box" size=".1 .1 .05" condim="1"/></body>
        </body></body></worldbody></mujoco>"""
    )


def test_link_that_turns_carries_a_foot_that_does_not():
    """The foot keeps its orientation and slides on the floor, while its path about the hip is curved."""
    model = _turning_leg()
    data = mujoco.MjData(model)
    data.qvel[:] = 6.0, 20.0, -20.0
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    assert _depths(model, data, stepper, np.zeros((10, 0))).max() <= _DEPTH


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_link_that_slides_out_of_one_that_turns_slowly_does_not_sink_in(direction):
    """Its Coriolis acceleration is twice the product of the two velocities."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep=".004" gravity="0 0 0"/><worldbody>
        <geom type="box" size="5 5 1" pos="0 0 -1"/>
        <body pos="0 0 .05"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body pos=".1 0 0"><joint type="slide" axis="1 0 0"/><geom size=".05" condim="1"/></body>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1 * direction, direction, 10.0 * direction
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    assert _depths(model, data, stepper, np.zeros((10, 0))).max() <= _DEPTH


def test_link_that_slides_and_turns_on_one_that_turns_does_not_sink_in():
    """The joint velocities of one body have a joint Coriolis acceleration."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep=".004" gravity="0 0 0"/><worldbody>
        <geom type="box" size="5 5 1" pos="0 0 -1"/>
        <body pos="0 0 .05"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body pos=".1 0 0"><joint type="slide" axis="1 0 0"/><joint axis="1 0 0"/><geom size=".05" condim="1"/></body>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1, 1.0, 10.0, 0.01
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    assert _depths(model, data, stepper, np.zeros((10, 0))).max() <= _DEPTH


def test_a_coin_that_wobbles_does_not_sink_in():
    """It touches the floor with a point of its rim, which moves around much faster than the coin turns."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><default><geom condim="6" friction=".5 .005 .001"/></default><worldbody>
        <geom type="plane" size="5 5 1"/><body pos="0 0 .11" euler="80 0 0"><freejoint/>
        <geom type="cylinder" size=".1 .005" mass=".2"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[4] = 3.0
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    assert _depths(model, data, stepper, np.zeros((1000, 0)))[100:].max() <= _DEPTH


_FLOORS = {"plane": 'type="plane" size="5 5 1"', "box": 'type="box" size="5 5 1" pos="0 0 -1"'}


@pytest.mark.parametrize("floor", _FLOORS)
def test_foot_around_a_joint_far_below_it_does_not_sink_in(floor):
    """Its center of mass is that of its parent, but turns about a joint half a meter below."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".008" gravity="0 0 0"/><worldbody><geom {_FLOORS[floor]}/>
        <body pos="0 0 .05"><joint type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body pos="0 0 -.5"><joint axis="0 1 0"/><geom size=".05" condim="1" pos="0 0 .5"/></body>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[1] = 2.0
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    assert _depths(model, data, stepper, np.zeros((10, 0))).max() <= _DEPTH


@pytest.mark.parametrize(("floor", "joint"), [("plane", "free"), ("box", "slide")])
def test_floor_that_turns_slowly_does_not_sink_into_a_body_far_from_its_axis(floor, joint):
    body = {
        "free": '<freejoint/><geom type="box" size=".1 .1 .05" friction="2"/>',
        "slide": '<joint type="slide" axis="0 0 1"/><geom size=".05" friction="2"/>',
    }[joint]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".008"/><worldbody>
        <body mocap="true"><geom {_FLOORS[floor]} friction="2"/></body>
        <body pos="2 0 .05">{body}</body></worldbody></mujoco>"""
    )
    data, seen = mujoco.MjData(model), mujoco.MjData(model)
    stepper, depth = Stepper(model, Moreau(0.0), scheme="time-stepping"), 0.0
    for step in range(300):
        angle = 0.15 * np.sin(0.02 * step)
        data.mocap_quat[0] = np.cos(angle), 0.0, np.sin(angle), 0.0
        stepper.step(data)
        seen.qpos[:], seen.mocap_quat[:] = data.qpos, data.mocap_quat
        mujoco.mj_fwdPosition(model, seen)
        depth = max(depth, -seen.contact.dist.min(initial=0.0))
    assert depth <= _DEPTH


_SHAPES = {"sphere": ".1", "capsule": ".05 .1", "ellipsoid": ".05 .1 .15", "cylinder": ".1 .05", "box": ".05 .1 .15"}


@pytest.mark.parametrize("shape", _SHAPES)
def test_thrown_shapes_do_not_sink_into_a_slope(shape):
    """They are fixed out of the centre of their body, and turn fast when they land."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="plane" size="5 5 1" euler="20 0 0"/><body pos="0 0 .5"><freejoint/>
        <inertial pos="0 0 0" mass="1" diaginertia=".02 .02 .02"/>
        <geom type="{shape}" size="{_SHAPES[shape]}" pos=".05 .1 0" euler="30 40 50"/></body></worldbody></mujoco>"""
    )
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(3):
        mujoco.mj_resetData(model, data)
        data.qvel[:] = random.normal(scale=[1, 1, 1, 15, 15, 15])
        data.qvel[2] = -2.0
        assert _depths(model, data, stepper, np.zeros((300, 0))).max() <= _DEPTH
