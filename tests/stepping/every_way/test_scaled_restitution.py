"""Restitution that is scaled so that a collision creates no energy is counted in every way to step."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Batch, Fremond, Moreau, Stepper
from impactlaw.laws import Law
from impactlaw.stepping.impact_event import ImpactSums

WAYS: dict[str, dict[str, Any]] = {
    "event-driven": {"scheme": "event-driven"},
    "time-stepping": {"scheme": "time-stepping"},
    "soft": {"contact_model": "soft", "compiled": "auto"},
    "soft in Python": {"contact_model": "soft", "compiled": "never"},
}
every_way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)

ROD = """<geom name="floor" type="plane" size="5 5 1" friction=".7"/>
<body pos="0 0 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".3333 .3333 .3333"/>
<geom name="tip" size=".01" pos=".6 0 -.8" friction=".7"/></body>"""


def rod():
    """Return Kane's oblique rod as its lower end hits the floor and slides: full restitution would create energy."""
    model, data = compiled(ROD, option='gravity="0 0 0" timestep="1e-3"')
    data.qpos[1], data.qvel[:2] = -0.1895, (-1.0, -1.0)
    return model, data


def counted(model, data, law: Law, **way: Any):
    """Step through the first collision; return the sums over it and its events."""
    stepper = Stepper(model, law, **way)
    for _ in range(5):
        stepper.step(data)
        if stepper.sums.collisions:
            return stepper.sums, stepper.events
    raise AssertionError("nothing collided")


@every_way
def test_a_scaled_collision_is_counted(way):
    sums, (event,) = counted(*rod(), Moreau(1.0), **way)
    assert 0.0 < event.impact.restitution_scale < 1.0
    assert event.impact.violations.is_admissible()
    assert sums[0] == sums.inadmissible == 1


@every_way
def test_a_collision_under_the_law_itself_is_not(way):
    sums, (event,) = counted(*rod(), Moreau(0.2), **way)
    assert event.impact.restitution_scale == 1.0
    assert sums.collisions == 1
    assert sums.inadmissible == 0


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_worlds_of_a_batch_count_their_steps(contact_model):
    model, data = rod()
    batch = Batch(model, [Moreau(1.0), Moreau(0.2), Moreau(1.0)], 3, 1, contact_model=contact_model)
    batch.bind("qpos")[:], batch.bind("qvel")[:] = data.qpos, data.qvel
    batch.bind("qvel")[2] *= -1.0  # upwards
    batch.step(nstep=5)
    assert batch.impact_count.tolist() == [1, 1, 0]
    assert batch.inadmissible_count.tolist() == [1, 0, 0]
    batch.reset([0])
    assert batch.inadmissible_count.tolist() == [0, 0, 0]


def test_a_law_that_is_let_through_is_counted():
    sums, (event,) = counted(*rod(), Moreau(1.0), scheme="time-stepping", on_inadmissible="allow")
    assert event.impact.energy_change > 1e-3
    assert sums.inadmissible == 1


GAINING = Fremond([[1.0, 1.5], [0.0, 1.0]])


@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
@pytest.mark.parametrize("scheme", ["event-driven", "time-stepping"])
def test_a_matrix_that_creates_energy_is_counted(scheme, friction):
    balls = (
        f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'
        for x in (0, 0.2, 0.4)
    )
    model, data = compiled("".join(balls), option='gravity="0 0 0" timestep="1e-3"', geom='condim="1"')
    data.qvel[:] = 1.0, 0.0, -1.0
    sums, (event, *_) = counted(model, data, GAINING, scheme=scheme, friction=friction, on_inadmissible="project")
    assert event.impact.energy_change < 1e-9
    assert event.impact.target_contact_velocity is None  # the outcome is not that of the law itself
    assert sums.inadmissible >= 1
    assert 0.5 * data.qvel @ data.qvel < 1.0 + 1e-9
    assert np.isfinite(data.qvel).all()


@pytest.mark.parametrize("how", ["auto", "never"])
@pytest.mark.parametrize("mass", [0.9, 0.995])
def test_a_time_step_that_creates_no_energy_is_not_counted(mass, how):
    """A force pushes the light ball, so that contact does negative work, though the collision by itself gains energy.

    Regression: `Stepper.sums` and events counted such a step, `Batch` did not.
    """
    balls = (
        f'<body pos="{0.2 * i} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="{m}"/></body>'
        for i, m in enumerate((mass, 1.0, 1.0))
    )
    model, data = compiled("".join(balls), option='gravity="0 0 0" timestep="1e-3"', geom='condim="1"')
    data.qvel[:], data.qfrc_applied[0] = (1.0, 0.0, -0.5), 300.0
    batch = Batch(model, Fremond.reversal(), 1, 1)
    batch.bind("qvel")[:], batch.bind("qfrc_applied")[:] = data.qvel, data.qfrc_applied
    batch.step()
    for asked in ("sums", "events"):
        ours = copy.copy(data)
        stepper = Stepper(model, Fremond.reversal(), scheme="time-stepping", on_inadmissible="project", compiled=how)
        stepper.step(ours)
        sums = stepper.sums if asked == "sums" else ImpactSums.of(stepper.events)
        np.testing.assert_array_equal(ours.qvel, batch.bind("qvel")[0])
        assert sums.collisions == batch.impact_count[0] == 1
        assert sums.inadmissible == batch.inadmissible_count[0] == 0
