"""Thin plates, whose two faces are close to each other: closing their contacts must not carry them away."""

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper

_PLATE = """<geom type="plane" size="9 9 1"/>
  <body pos="0 0 .3" euler="{tilt}"><freejoint/><geom type="box" size=".2 .2 {half}" mass=".1"/></body>"""


@pytest.mark.parametrize("half", [1e-5, 2e-5, 1e-4])
@pytest.mark.parametrize("tilt", ["10 20 0", "4 7 0"])
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_no_step_moves_a_plate_farther_than_its_velocity(e, integrator, tilt, half):
    model, data = compiled(_PLATE.format(tilt=tilt, half=half), option=f'timestep="2e-3" integrator="{integrator}"')
    stepper = Stepper(model, Moreau(e))
    for _ in range(400):
        before, speed = data.qpos[:3].copy(), np.linalg.norm(data.qvel[:3])
        stepper.step(data)
        speed = max(speed, np.linalg.norm(data.qvel[:3]))
        assert np.linalg.norm(data.qpos[:3] - before) < 2.0 * speed * model.opt.timestep + 1e-4
    assert data.qpos[2] < 0.3


@pytest.mark.parametrize("tilt", ["10 20 0", "4 7 0"])
def test_a_foil_lies_down_without_time_stepping(tilt):
    """Its two faces are 20 micrometers apart: a contact of one must not pass for two, which cannot both be closed."""
    model, data = compiled(_PLATE.format(tilt=tilt, half=1e-5), option='timestep="2e-3"')
    stepper = Stepper(model, Moreau(0.0), on_unsolved="raise")
    for _ in range(300):
        stepper.step(data)
    np.testing.assert_allclose(data.qpos[2], 1e-5, atol=1e-8)
    np.testing.assert_allclose(data.qvel, 0.0, atol=1e-6)
