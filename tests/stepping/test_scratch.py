"""Copies of steppers have data of their own: pickled data share MuJoCo's plugins, which are then freed twice."""

import io
import pickle

import mujoco
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.scratch import Scratch

_BALLS = """
<mujoco>
  <option integrator="RK4" timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .11"><freejoint/><geom size=".1"/></body>
    <body pos=".05 0 .32"><freejoint/><geom size=".1"/></body>
  </worldbody>
</mujoco>"""
_TORUS = """
<mujoco>
  <extension><plugin plugin="mujoco.sdf.torus"><instance name="torus"/></plugin></extension>
  <asset><mesh name="torus"><plugin instance="torus"/></mesh></asset>
  <worldbody>
    <body><freejoint/><geom type="sdf" mesh="torus"><plugin instance="torus"/></geom></body>
  </worldbody>
</mujoco>"""
_WAYS = {
    "soft": {"contact_model": "soft"},
    "soft, in Python": {"contact_model": "soft", "compiled": "never"},
    "time stepping": {"scheme": "time-stepping"},
    "event-driven": {},
}


@pytest.mark.parametrize("way", _WAYS)
def test_pickles_of_steppers_contain_no_data(way):
    model = mujoco.MjModel.from_xml_string(_BALLS)
    stepper, data, count = Stepper(model, Moreau(0.5), **_WAYS[way]), mujoco.MjData(model), 0
    for _ in range(300):
        stepper.step(data)
        count += len(stepper.events)  # steps are repeated in other data
    assert count > 2
    assert not _data_in((stepper, stepper.told))
    assert _data_in(data)


def test_copies_have_plugins_of_their_own():
    model = mujoco.MjModel.from_xml_string(_TORUS)
    scratch = Scratch(model)
    first = int(scratch.data.plugin_data[0])
    again = pickle.loads(pickle.dumps(scratch))
    assert int(again.data.plugin_data[0]) != first
    assert scratch.data is scratch.data


def _data_in(thing):
    """Return the data of MuJoCo in a pickle."""
    found = []

    class Pickler(pickle.Pickler):
        def reducer_override(self, part):
            if isinstance(part, mujoco.MjData):
                found.append(part)
            return NotImplemented

    Pickler(io.BytesIO()).dump(thing)
    return found
