"""A ball on a floor, all ways to step it, and its speed of rebound."""

import mujoco
import pytest

WAYS = {
    "soft": {"contact_model": "soft"},
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
}
every_way = pytest.mark.parametrize("way", WAYS)


def ball(condim=1, option="", numeric=""):
    """Return a ball 1 m above a floor."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002" {option}/><custom>{numeric}</custom>
      <worldbody><geom name="floor" type="plane" size="1 1 1" condim="{condim}"/>
      <body pos="0 0 1.1"><freejoint/><geom name="ball" size=".1" mass="1" condim="{condim}"/></body></worldbody>
      </mujoco>""")
    return model, mujoco.MjData(model)


def rebound(stepper, data):
    """Return the part of its speed that the ball keeps in its next collision."""
    for _ in range(2000):
        stepper.step(data)
        if stepper.events:
            impact = stepper.events[0].impact
            return -impact.post_contact_velocity[0] / impact.collision.pre_contact_velocity[0]
    raise AssertionError("the ball has not hit the floor")
