"""A step in which compiled code meets a contact for the first time, whose coefficient it has to look up in the law."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Newton, Stepper
from scripts.robots.agreement import compiled_stepper

BAR = '<geom type="capsule" size=".02" fromto="0 0 0 {end}" mass="{mass}" contype="0" conaffinity="0"/>'
CHAIN = f"""<mujoco><option timestep="0.004"/><compiler autolimits="true"/><worldbody>
  <body><joint axis="0 0 1"/>{BAR.format(end=".3 0 0", mass=1)}
    <body pos=".3 0 0"><joint name="b" axis="0 1 0" range="-60 60"/>{BAR.format(end=".2 0 0", mass=0.3)}
      <body pos=".2 0 0"><joint name="c" axis="1 0 1" range="-60 60"/>{BAR.format(end=".1 .1 0", mass=0.05)}</body>
    </body></body></worldbody></mujoco>"""
"""Three bars that turn so fast that a collision is looked at once more for the energy of Coriolis forces."""
STATES = [
    ((0.759, 0.877, -0.759), (-17.05, 35.58, -31.77)),
    ((-1.044, 1.007, -0.800), (-13.72, 50.85, -23.96)),
    ((0.984, 0.998, -0.289), (-18.23, 60.51, -40.66)),
    ((-0.683, math.radians(-60) - 0.0397, 1.047), (20.73, -12.93, 0.16)),
]


@pytest.mark.parametrize("state", STATES)
def test_limits_that_are_not_known_yet(state: tuple[tuple[float, ...], tuple[float, ...]]):
    """Such a collision was given up, or became another one: it was looked at once more before the law was asked."""
    model = mujoco.MjModel.from_xml_string(CHAIN)
    law, first = Newton({"b": 0.5}, default=0.5), []
    for stepper in (compiled_stepper(model, law), Stepper(model, law, scheme="time-stepping", compiled="never")):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = state
        stepper.step(data)
        first.append((stepper.sums.collisions, data.qpos.copy(), data.qvel.copy()))
    batch = Batch(model, law, 1)
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    qpos[:], qvel[:] = state
    batch.step()
    (ours, *reached), (python, *expected) = first
    assert ours == python > 0
    np.testing.assert_allclose(np.hstack(reached), np.hstack(expected), rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(np.hstack([qpos[0], qvel[0]]), np.hstack(reached))
