"""A box at rest, and the shortcut that a stepper takes for it."""

import mujoco
import numpy as np
import pytest
from stepping.event_driven.shortcuts.seen import tried

from impactlaw import Moreau, Stepper

BOX = """
<mujoco>
  <option timestep="0.005" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" euler="{slope} 0 0" condim="{condim}" friction="0.6 0.005 0.0001"/>
    <body name="box" euler="{slope} 0 0" pos="{position}">
      <freejoint/>
      <geom name="box" type="box" size="0.25 0.2 0.125" mass="2" condim="{condim}" friction="0.6 0.005 0.0001"/>
    </body>
    {more}
  </worldbody>
</mujoco>"""


def scene(integrator="RK4", *, condim=1, slope=0.0, more=""):
    """Return a box that lies on a plane, and its state after some steps."""
    angle = np.radians(slope)
    position = " ".join(map(str, 0.125 * np.array([0, -np.sin(angle), np.cos(angle)])))
    text = BOX.format(integrator=integrator, condim=condim, slope=slope, position=position, more=more)
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def settled(model, data, **options):
    stepper = Stepper(model, Moreau(0.0), **options)
    for _ in range(5):
        stepper.step(data)
    return stepper


def shortcut_of(stepper, data):
    """Return the shortcut that a step has taken, and its argument; the next step would try it again."""
    with pytest.MonkeyPatch.context() as patch:
        seen = tried(patch)
        stepper.step(data)
    assert [one.held for one in seen] == [True]
    return seen[0].shortcut, seen[0].phases


def lasts(shortcut, phases):
    with phases.options:
        return shortcut.lasts(phases)
