"""Scenes with friction for the work-precision study: a block that slides and stops, a rod, a quadruped."""

import mujoco
import numpy as np

Loaded = tuple[mujoco.MjModel, mujoco.MjData]

FRICTION, SPEED = 0.3, 1.0
"""The block's coefficient of friction, and its initial speed, m/s."""
ROD_FRICTION, HALF_LENGTH, TIP = 0.3, 0.5, 0.03
"""The rod's coefficient of friction, its half length and the radius of its tips, m; its mass is 1 kg."""
ROD_START = (0.0, 0.4, 0.6, -0.6, 0.0, 0.0)
"""Start of the rod: x, height and angle, and their velocities."""
LEGS = {"front_left": (0.2, 0.12), "front_right": (0.2, -0.12), "rear_left": (-0.2, 0.12), "rear_right": (-0.2, -0.12)}
"""Positions of the quadruped's hips on the trunk, m; its feet have the names of the legs."""
FOOT, DROP = 0.02, 0.05
"""The radius of the quadruped's feet, and their height above the floor at the start, m."""
STANCE = np.tile([0.6, -1.2], len(LEGS))
"""The angles of hips and knees that the quadruped's servos hold, rad."""

_HEAD = '<option integrator="RK4" cone="elliptic"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>'
_PLANAR = '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'


def sliding_block() -> Loaded:
    """Return a block that slides on its four corners; it can only move and turn in the plane of its velocity."""
    xml = f"""<mujoco model="sliding_block"><default><geom friction="{FRICTION} 0 0"/></default>{_HEAD}
        <body pos="0 0 .125">{_PLANAR}<joint name="pitch" type="hinge" axis="0 1 0"/>
        <geom name="block" type="box" size=".25 .125 .125" mass="1"/></body></worldbody></mujoco>"""
    model, data = _load(xml)
    data.qvel[0] = SPEED
    return model, data


def rod() -> Loaded:
    """Return a tilted thin rod above the floor, which moves in a plane.

    Its lower tip sticks when it lands, then slips to the right, sticks again, and slips to the left, until the other
    tip lands and the rod stops.
    """
    xml = f"""<mujoco model="rod_with_friction"><default><geom friction="{ROD_FRICTION} 0 0" size="{TIP}"/></default>
        {_HEAD}<body pos="0 0 {TIP}"><inertial pos="0 0 0" mass="1" diaginertia=".001 {1 / 12:.17g} {1 / 12:.17g}"/>
        {_PLANAR}<joint name="angle" type="hinge" axis="0 1 0"/>
        <geom name="left" pos="{-HALF_LENGTH} 0 0"/><geom name="right" pos="{HALF_LENGTH} 0 0"/>
        </body></worldbody></mujoco>"""
    model, data = _load(xml)
    data.qpos[:], data.qvel[:] = ROD_START[:3], ROD_START[3:]
    return model, data


def quadruped() -> Loaded:
    """Return a robot of 9 kg with two servo-driven hinges per leg and feet of condim 3, which drops and then stands.

    It is symmetric, and its feet land at the same time.
    """
    legs = "".join(
        f"""<body pos="{x} {y} 0"><joint name="{name}_hip"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".6"/>
        <body pos="0 0 -.2"><joint name="{name}_knee"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".015" mass=".2"/>
        <geom name="{name}" size="{FOOT}" pos="0 0 -.2" mass=".05" contype="1" conaffinity="1"/></body></body>"""
        for name, (x, y) in LEGS.items()
    )
    servos = "".join(f'<position joint="{name}_{joint}" kp="120"/>' for name in LEGS for joint in ("hip", "knee"))
    xml = f"""<mujoco model="quadruped"><default><geom contype="0" conaffinity="0" friction="1 0 0"/>
        <joint axis="0 1 0" damping="3" armature=".01"/></default>
        {_HEAD.replace('type="plane"', 'type="plane" contype="1" conaffinity="1"')}<body name="trunk"><freejoint/>
        <geom type="box" size=".25 .1 .05" mass="6"/>{legs}</body></worldbody><actuator>{servos}</actuator></mujoco>"""
    model, data = _load(xml)
    data.qpos[7:] = data.ctrl[:] = STANCE
    mujoco.mj_kinematics(model, data)
    data.qpos[2] = DROP - min(gaps(model, data))
    return model, data


def gaps(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the heights of the quadruped's feet above the floor, (4,), m; frames must be current."""
    return np.array([data.geom(name).xpos[2] for name in LEGS]) - FOOT


def _load(xml: str) -> Loaded:
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)
