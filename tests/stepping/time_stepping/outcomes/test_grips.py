"""Grippers hold what they grip."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_pads_with_flat_round_ends_hold_a_cylinder(restitution):
    """Asked for overlaps only, MuJoCo reports 7.7 mm between a pad and the cylinder in 1 of 50 poses that touch."""
    pad = '<geom type="cylinder" size=".012 .005" euler="90 0 0" mass=".05"/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.002"/><worldbody><body name="hand">
        <joint name="lift" type="slide" axis="0 0 1"/><geom size=".01" mass="1" contype="0" conaffinity="0"/>
        <body pos="0 .0251 0"><joint name="left" type="slide" axis="0 -1 0" damping="2"/>{pad}</body>
        <body pos="0 -.0251 0"><joint name="right" type="slide" axis="0 1 0" damping="2"/>{pad}</body></body>
        <body name="can" pos="0 0 .01"><freejoint/><geom type="cylinder" size=".02 .03" mass=".2" friction=".8"/></body>
        </worldbody><actuator><position joint="lift" kp="4000" kv="150"/>
        <motor joint="left"/><motor joint="right"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(restitution), scheme="time-stepping")
    data.ctrl[1:] = 15.0
    offsets = []
    for step in range(600):
        data.ctrl[0] = 0.02 * np.sin(0.05 * step)
        stepper.step(data)
        offsets.append(data.body("can").xpos - data.body("hand").xpos)
    held = np.array(offsets[100:])
    assert np.abs(held - held[0]).max() < 1e-6
    assert stepper.short_steps == 0
