"""Which outcomes are counted as outside S(v-): not every collision of a law with its own rule."""

import mujoco
import pytest

from impactlaw import Fremond, Law, Moreau, Stepper
from impactlaw.laws import Poisson, Routh
from impactlaw.stepping.impact_event import ImpactSums

_SCENE = """<mujoco><worldbody><geom type="plane" size="2 2 .1" friction=".5"/>
  <body pos="0 0 .3"><freejoint/><geom size=".1" friction=".5"/></body></worldbody></mujoco>"""
_WAYS = {"event-driven": {}, "time stepping": {"scheme": "time-stepping"}, "soft": {"contact_model": "soft"}}


def _sums(law: Law, **options: str) -> ImpactSums:
    model = mujoco.MjModel.from_xml_string(_SCENE)
    stepper, data, total = Stepper(model, law, **options), mujoco.MjData(model), ImpactSums()
    data.qvel[0] = 0.3
    for _ in range(150):
        stepper.step(data)
        total = total.with_more(stepper.sums)
    return total


@pytest.mark.parametrize("way", _WAYS)
@pytest.mark.parametrize("law", [Moreau(0.5), Poisson(0.5), Routh(0.5)], ids=repr)
def test_outcomes_in_S_are_not_counted(law: Law, way: str) -> None:
    sums = _sums(law, **_WAYS[way])
    assert sums.collisions > 0
    assert sums.inadmissible == 0


@pytest.mark.parametrize("way", ["event-driven", "soft"])
def test_outcomes_that_are_projected_are_counted(way: str) -> None:
    sums = _sums(Fremond([[1.5]]), on_inadmissible="project", friction="ignore", **_WAYS[way])
    assert sums.inadmissible == sums.collisions > 0
