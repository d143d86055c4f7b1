"""Limbs that overlap at a common joint: none of their motions opens such a contact, so it must have no effect."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_LIMBS = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body pos="0 0 1">
      <freejoint/>
      <geom type="sphere" size="0.02"/>
      <body>
        <joint name="one" type="ball"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" condim="{condim}"/>
      </body>
      <body>
        <joint name="other" axis="0.2 1 0"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0.05 0.2" condim="{condim}"/>
      </body>
      <body>
        <joint name="third" axis="0 1 0.3"/>
        <geom type="capsule" size="0.015" fromto="0 0 0 -0.1 -0.1 -0.1" condim="{condim}"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""


def _moved(condim, restitution, contact, steps=400):
    """Return the positions of all steps, (steps, nq), and whether there were contacts."""
    model = mujoco.MjModel.from_xml_string(_LIMBS.format(condim=condim))
    if not contact:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(restitution), scheme="time-stepping")
    data.qvel[:] = np.random.default_rng(0).normal(size=model.nv)
    positions, touched = [], False
    for _ in range(steps):
        stepper.step(data)
        positions.append(data.qpos.copy())
        touched |= data.ncon > 2
    assert stepper.short_steps == 0
    return np.array(positions), touched


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("condim", [1, 3])
def test_limbs_that_overlap_at_their_joint_swing_freely(condim, restitution):
    held, touched = _moved(condim, restitution, contact=True, steps=200)
    free, _ = _moved(condim, restitution, contact=False, steps=200)
    assert touched
    np.testing.assert_allclose(held, free, atol=1e-9)
