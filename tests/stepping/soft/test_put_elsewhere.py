"""States that are written between steps: each step detects contacts anew, whatever the last one found."""

from __future__ import annotations

import mujoco
import pytest
from scenes import INTEGRATORS, compiled

from impactlaw import Moreau, Stepper


def ball(integrator):
    """Return a ball high above a floor after one step, and its stepper."""
    return compiled(
        '<geom type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/><geom size=".1" condim="1"/></body>',
        option=f'integrator="{integrator}"',
    )


@pytest.mark.parametrize("looked", [False, True], ids=["as it is", "after mj_forward"])
@pytest.mark.parametrize("compiled_code", [None, "never"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_ball_that_is_put_on_the_floor_bounces_at_once(integrator, compiled_code, looked):
    model, data = ball(integrator)
    stepper = Stepper(model, Moreau(1.0), contact_model="soft", compiled=compiled_code)
    stepper.step(data)
    data.qpos[2], data.qvel[2] = 0.098, -3.0
    if looked:
        mujoco.mj_forward(model, data)
    stepper.step(data)
    assert stepper.sums.collisions == 1
    assert data.qvel[2] == pytest.approx(3.0, abs=0.03)


@pytest.mark.parametrize("compiled_code", [None, "never"])
def test_a_ball_that_grows_to_touch_bounces_at_once(compiled_code):
    model, data = ball("RK4")
    stepper = Stepper(model, Moreau(1.0), contact_model="soft", compiled=compiled_code)
    data.qpos[2], data.qvel[2] = 0.2, -3.0
    stepper.step(data)
    assert stepper.sums.collisions == 0
    model.geom_size[1, 0] = model.geom_rbound[1] = data.qpos[2] + 1e-4
    stepper.step(data)
    assert stepper.sums.collisions == 1
    assert data.qvel[2] == pytest.approx(3.0, abs=0.06)
