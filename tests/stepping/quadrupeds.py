"""A four-legged robot held by servos."""

import mujoco
import numpy as np

STANCE = np.tile([0.0, 0.7, -1.4], 4)


def quadruped(condim=3, *, timestep=4e-3, servo=True, integrator="implicitfast", armature=0.0):
    legs, actuators = "", ""
    for name, x, y in (("fl", 0.2, 0.12), ("fr", 0.2, -0.12), ("rl", -0.2, 0.12), ("rr", -0.2, -0.12)):
        legs += f"""<body name="{name}_hip" pos="{x} {y} 0"><joint name="{name}_roll" axis="1 0 0" range="-60 60"/>
            <geom type="capsule" fromto="0 0 0 0 {np.sign(y) * 0.05} 0" size=".03" mass=".7"/>
            <body pos="0 {np.sign(y) * 0.05} 0"><joint name="{name}_thigh" axis="0 1 0" range="-90 120"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.21" size=".02" mass=".8"/>
            <body pos="0 0 -.21"><joint name="{name}_knee" axis="0 1 0" range="-150 -30"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.18" size=".012" mass=".15"/>
            <geom name="{name}" size=".02" pos="0 0 -.21" mass=".05" condim="{condim}"
                friction=".8 .02 .01" contype="1"/>
            </body></body></body>"""
        actuators += "".join(
            f'<position joint="{name}_{joint}" kp="120" kv="4"/>' for joint in ("roll", "thigh", "knee")
        )
    xml = f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"/>
        <default><geom contype="0" conaffinity="0"/><joint armature="{armature}"/></default><worldbody>
        <geom name="floor" type="plane" size="9 9 1" contype="1" conaffinity="1"/>
        <body name="trunk" pos="0 0 .4"><freejoint/><geom type="box" size=".25 .09 .05" mass="8"/>
        {legs}</body></worldbody>
        {f"<actuator>{actuators}</actuator>" if servo else ""}</mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[7:] = STANCE
    mujoco.mj_forward(model, data)
    feet = [model.geom(name).id for name in ("fl", "fr", "rl", "rr")]
    data.qpos[2] += 0.02 - data.geom_xpos[feet, 2].min()
    if servo:
        data.ctrl[:] = STANCE
    return model, data, feet


def gaps(model, data, feet):
    mujoco.mj_kinematics(model, data)
    return data.geom_xpos[feet, 2] - model.geom_size[feet, 0]
