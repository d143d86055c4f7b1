"""Values that are not finite raise an error, and leave everything as it was."""

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.promises.started import assert_same, model_state
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau
from impactlaw.errors import DivergenceError


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("field", ["qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied", "act"])
def test_what_is_not_finite_raises_and_leaves_everything_as_it_was(field, value, quiet):
    world = FLOOR + '<body pos="0 0 .1"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model, data = compiled(world, '<actuator><general joint="up" dyntype="integrator" gainprm="1"/></actuator>')
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 3)
    array = getattr(data, field)
    array.reshape(-1)[0] = value
    before = {name: getattr(data, name).copy() for name in ("qpos", "qvel", "act", "ctrl", "mocap_pos")}
    flags, time = model_state(model), data.time
    with pytest.raises(DivergenceError):
        stepper.step(data)
    for name, old in before.items():
        np.testing.assert_array_equal(getattr(data, name), old)
    assert data.time == time
    assert_same(model_state(model), flags)
    mujoco.mj_resetData(model, data)
    run(stepper, data, 3)
    assert np.isfinite(data.qpos).all()


def test_an_explosion_within_a_step_raises_and_restores(quiet):
    world = '<body><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model, data = compiled(world, '<actuator><motor joint="up" gear="1e9"/></actuator>')
    data.ctrl[0] = 1e9
    stepper = stepping(model, Moreau(0.5))
    with pytest.raises(DivergenceError):
        run(stepper, data, 10)
    assert np.isfinite(data.qpos).all()
    assert np.isfinite(data.qvel).all()


@pytest.mark.parametrize("compiled_code", ["auto", "never"])
def test_step_that_raises_has_no_events_and_can_be_taken_again(compiled_code, quiet):
    """A moving mocap body still moves in the step that is taken again, and throws the ball."""
    world = """<body mocap="true"><geom type="box" size=".2 .2 .01"/></body>
        <body pos="0 0 .0312"><joint type="slide" axis="0 0 1"/><geom size=".02" condim="1" mass="1e-4"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"')
    stepper = stepping(model, Moreau(1.0), compiled=compiled_code)
    stepper.step(data)
    data.mocap_pos[0, 2] = 1e-3
    data.qfrc_applied[0] = 9e9
    with pytest.raises(DivergenceError, match=r"t = 0\.002"):
        stepper.step(data)
    data.qfrc_applied[0] = 0.0
    stepper.step(data)
    assert data.qvel[0] == pytest.approx(1.0)
    assert len(stepper.events) == 1
    data.qfrc_applied[0] = 9e9
    with pytest.raises(DivergenceError):
        stepper.step(data)
    assert stepper.events == ()
