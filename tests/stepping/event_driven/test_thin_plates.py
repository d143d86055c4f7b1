"""Thin plates, whose two faces are close to each other: closing their contacts must not carry them away."""

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.errors import SolverError

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


def test_a_shift_that_would_is_an_error_where_nothing_else_may_take_the_step():
    model, data = compiled(_PLATE.format(tilt="10 20 0", half=1e-5), option='timestep="2e-3"')
    stepper = Stepper(model, Moreau(0.0), on_unsolved="raise")
    with pytest.raises(SolverError, match="no small shift closes"):
        for _ in range(400):
            stepper.step(data)
