"""Jammed bodies: with friction no impulse separates them, whatever the law asks for."""

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Law, Moreau, Newton, Stepper

_ON_A_RAIL = """<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <geom type="plane" size="5 5 1" friction="{friction}"/>
    <body pos="0 0 0.101">
      <joint type="slide" axis="1 0 -0.5"/>
      <geom size="0.1" friction="{friction}"/>
    </body>
  </worldbody>
</mujoco>"""
_MOREAU: Law = Moreau(0.5)


def _stepped(friction, *, law: Law = _MOREAU, compiled=None, steps=5):
    model = mujoco.MjModel.from_xml_string(_ON_A_RAIL.format(friction=friction))
    data, stepper = mujoco.MjData(model), Stepper(model, law, scheme="time-stepping", compiled=compiled)
    data.qvel[0] = 2.0
    for _ in range(steps):
        stepper.step(data)
    return data, stepper


def test_a_mass_on_a_rail_rebounds_while_friction_lets_it():
    data, stepper = _stepped(0.4)
    np.testing.assert_allclose(data.qvel[0], -1.0, atol=1e-9)
    assert stepper.short_steps == 0


@pytest.mark.parametrize("friction", [0.6, 1.0, 3.0])
def test_it_stays_where_friction_holds_it_and_that_is_counted(friction):
    """Friction against backward slip would press it on: a solution exists only without restitution."""
    data, stepper = _stepped(friction)
    np.testing.assert_allclose(data.qvel[0], 0.0, atol=1e-9)
    assert stepper.short_steps == 1
    assert stepper.shortfall < 1e-9


def test_many_worlds_count_it_each_by_itself():
    batch = Batch(mujoco.MjModel.from_xml_string(_ON_A_RAIL.format(friction=1.0)), Moreau(0.5), 3, 2)
    batch.bind("qvel")[:, 0] = 0.0, 2.0, 0.0
    batch.step(nstep=5)
    assert batch.short_steps.tolist() == [0, 1, 0]


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_what_jams_under_a_law_by_pair_does_so_too(compiled):
    data, stepper = _stepped(1.0, law=Newton({"*": 0.5}), compiled=compiled)
    np.testing.assert_allclose(data.qvel[0], 0.0, atol=1e-9)
    assert stepper.short_steps == 1
