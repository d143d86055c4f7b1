"""Scenes that event-driven stepping would simulate wrongly are refused, and told where to go."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.errors import SceneError

MUG = """<mujoco><extension><plugin plugin="mujoco.sdf.torus"><instance name="torus"/></plugin></extension>
  <asset><mesh name="torus"><plugin instance="torus"/></mesh></asset>
  <worldbody><geom type="plane" size="2 2 .1" {floor}/>
    <body pos="0 0 1"><freejoint/><geom name="ring" type="sdf" mesh="torus"><plugin instance="torus"/></geom></body>
  </worldbody></mujoco>"""


@pytest.fixture(scope="module", autouse=True)
def plugins():
    mujoco.mj_loadAllPluginLibraries(str(Path(mujoco.__file__).parent / "plugin"))


def test_signed_distance_functions_are_refused_and_time_stepped():
    model = mujoco.MjModel.from_xml_string(MUG.format(floor=""))
    with pytest.raises(SceneError, match=r'ring.*scheme="time-stepping"'):
        Stepper(model, Moreau(0.5))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(100):
        stepper.step(data)
    assert data.qpos[2] < 1.0


def test_signed_distance_functions_that_meet_nothing_are_not():
    model = mujoco.MjModel.from_xml_string(MUG.format(floor='contype="0" conaffinity="0"'))
    Stepper(model, Moreau(0.5)).step(mujoco.MjData(model))
