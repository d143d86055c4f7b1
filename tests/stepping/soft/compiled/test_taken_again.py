"""Steps of RK4 that compiled code takes again are as those that it takes at once, and as those of Python.

The last stage of an RK4 step need not meet what its end does: the next step looks at what touches itself.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np

from impactlaw import Batch, Moreau, Newton, Stepper

BALL = """<mujoco><option timestep="0.01" integrator="RK4" gravity="0 0 0"/><worldbody>
  <geom name="floor" type="plane" size="3 3 1"/>
  <body pos="0 0 .2"><joint type="slide" axis="0 0 1" stiffness="-15000"/><geom name="ball" size=".1" mass="1"/></body>
  </worldbody></mujoco>"""
ANT = (
    (0.06587, -0.005076, 0.6728, 0.9878, 0.0865, 0.07513, 0.1054, 0.09718, 1.06, -0.3661, -0.9937, -0.303, -1.22,
     -0.2742, 0.5645),
    (0.4326, 0.3058, -1.731, 1.016, -0.07037, 1.8, -5.028, -0.9993, 8.732, -14.76, -8.564, -0.8834, -8.684, 2.395),
    (0.5259, -0.5795, -0.7912, 0.08681, -0.1989, -0.452, -0.9535, -0.9733),
)  # fmt: skip
"""Positions, velocities and controls of an Ant that in a step comes to a limit which its last stage does not meet."""


def test_a_contact_that_was_not_known_collides_as_one_that_was():
    model, ends = mujoco.MjModel.from_xml_string(BALL), []
    for law in (Moreau(0.5), Newton({("ball", "floor"): 0.5}, default=0.1)):
        stepper, data = Stepper(model, law, contact_model="soft"), mujoco.MjData(model)
        batch = Batch(model, law, 1, 1, contact_model="soft")
        data.qvel[0] = batch.bind("qvel")[0] = -4.60887
        for _ in range(4):
            stepper.step(data)
            batch.step()
            ends.append((data.qvel[0], batch.bind("qvel")[0, 0]))
    np.testing.assert_array_equal(ends[:4], ends[4:])
    np.testing.assert_array_equal(*np.transpose(ends))


def test_what_the_last_stage_has_not_met_collides_where_the_next_step_begins():
    env: Any = gymnasium.make("Ant-v5").unwrapped
    ends = []
    for compiled in (None, "never"):
        stepper = Stepper(env.model, Moreau(1.0), contact_model="soft", compiled=compiled)
        data = mujoco.MjData(env.model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = ANT
        counts = []
        for _ in range(3):
            stepper.step(data)
            counts.append(len(stepper.events))
        ends.append((counts, data.qvel.copy()))
    assert ends[0][0] == ends[1][0] == [0, 2, 1]
    np.testing.assert_allclose(ends[0][1], ends[1][1], rtol=0.0, atol=1e-10)
