"""Scenes that event-driven stepping would simulate wrongly are refused, with an alternative."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.errors import SceneError, UnreadSensorsWarning

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


SENSORS = (
    '<sensor><touch name="pad" site="s"/><force site="s"/><accelerometer site="s"/><jointpos joint="j"/>{}</sensor>'
)


def test_sensors_of_contact_are_told():
    """Contact forces are not in data after event-driven steps; accelerations are."""
    joint = '<joint name="j" axis="0 0 1" range="-2 2" limited="{}"/>'
    leg = f'<body pos="0 0 1">{joint}<geom size=".1"/><site name="s"/></body>'
    model, _ = compiled(leg.format("true"), SENSORS.format('<jointlimitfrc name="limit" joint="j"/>'))
    with pytest.warns(UnreadSensorsWarning, match=r'such as pad, sensor1, limit read .*scheme="time-stepping"') as told:
        Stepper(model, Moreau(0.5))
    assert told[0].filename == __file__
    Stepper(model, Moreau(0.5), scheme="time-stepping")
    Stepper(model, Moreau(0.5), contact_model="soft")
    Stepper(compiled(leg.format("false"), SENSORS.format(""))[0], Moreau(0.5))  # no possible contact


def test_touch_grids_are_told():
    """A plugin may read contacts, as MuJoCo's touch grid does."""
    plugin = '<extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>'
    grid = """<sensor><plugin name="grid" plugin="mujoco.sensor.touch_grid" objtype="site" objname="s">
        <config key="size" value="2 2"/><config key="fov" value="45 45"/><config key="gamma" value="0"/>
        <config key="nchannel" value="1"/></plugin></sensor>"""
    pad = '<geom type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/><geom size=".1"/><site name="s"/></body>'
    model, _ = compiled(pad, plugin + grid)
    with pytest.warns(UnreadSensorsWarning, match="grid read"):
        Stepper(model, Moreau(0.5))
