"""Compiling what a step needs, once on every machine; later processes load it from numba's cache on disk."""

from __future__ import annotations

from functools import cache

import mujoco

from impactlaw.compiled import announce
from impactlaw.laws import Moreau
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.time_stepping.scheme import TimeStepping

_SCENE = """<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .09"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""


@cache
def warm_up() -> None:
    """Take two steps of a spinning box that overlaps a floor: they call all that is compiled."""
    announce("impactlaw.stepping.time_stepping")
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data, plan = mujoco.MjData(model), make_plan(model, scheme="time-stepping")
    data.qvel[:] = 0.0, 0.0, -1.0, 9.0, 9.0, 9.0
    stepping = TimeStepping(model, Moreau(0.5), plan, friction="coulomb", on_inadmissible="project", rest_speed=None)
    stepping.step(data)
    stepping.step(data)
