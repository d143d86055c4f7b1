"""MuJoCo finds no contact of some boxes that are still apart: overlaps that arise so are counted in the next step."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_COUNTED = 1e-5  # m
# sizes and attitudes of two boxes; position, velocity and spin of the second, spin of the first
_MISSED = [
    ((0.167, 0.012, 0.141), (0.073, 0.024, 0.012), (-0.348, 0.781, -0.195, -0.480), (-0.001, 0.240, -0.900, 0.363),
     (0.452, 0.103, -0.102), (-2.382, -0.826, 0.542), (-6.190, -2.197, -1.982), (-3.090, -0.801, -4.969)),
    ((0.014, 0.090, 0.041), (0.143, 0.014, 0.020), (0.674, 0.219, 0.681, 0.182), (-0.419, -0.273, 0.167, 0.850),
     (0.066, -0.345, -0.025), (-0.768, 2.777, 0.294), (-0.687, 1.780, 9.164), (0.925, 0.216, 2.133)),
]  # fmt: skip


@pytest.mark.parametrize("start", _MISSED)
def test_overlap_of_boxes_that_mujoco_has_not_seen_is_counted(start):
    sizes, turns, (place, velocity, spin, other_spin) = start[:2], start[2:4], start[4:]
    bodies = ""
    for size, turn in zip(sizes, turns, strict=True):
        geom = f'<geom type="box" size="{size[0]} {size[1]} {size[2]}"/>'
        bodies += f'<body quat="{turn[0]} {turn[1]} {turn[2]} {turn[3]}"><freejoint/>{geom}</body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep=".01" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    )
    data, seen = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[7:10], data.qvel[3:6], data.qvel[6:9], data.qvel[9:] = place, other_spin, velocity, spin
    stepper, depth = Stepper(model, Moreau(0.5), scheme="time-stepping"), 0.0
    while depth < _COUNTED and data.time < 0.3:
        assert stepper.short_steps == 0
        stepper.step(data)
        seen.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, seen)
        depth = -mujoco.mj_geomDistance(model, seen, 0, 1, 1.0, None)
    assert depth > 1e-3
    stepper.step(data)
    assert stepper.short_steps == 1
    for _ in range(5):
        stepper.step(data)
    assert stepper.short_steps == 1


def test_overlap_in_which_a_step_begins_is_not_counted():
    """Where a state is set, no step has failed to see the contact."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0"/><worldbody>
        <body><freejoint/><geom type="box" size=".1 .1 .1"/></body>
        <body pos="1 0 0"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(3):
        stepper.step(data)
    data.qpos[7] = 0.19
    for _ in range(3):
        stepper.step(data)
    assert stepper.short_steps == 0
    assert np.abs(data.qvel).max() < 1e-9
