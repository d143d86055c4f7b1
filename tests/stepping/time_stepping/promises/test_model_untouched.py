"""A step does not change the model, and changes of the model between steps take effect."""

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.promises.started import assert_same, box, model_state, pile
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
def test_the_model_is_after_every_step_what_it_was_before(cone, jacobian):
    option = f'integrator="RK4" cone="{cone}" jacobian="{jacobian}" solver="CG" impratio="3"'
    world = pile(4).replace("<geom", '<geom margin="0.01" gap="0.005"', 3)
    world += '<body pos="3 0 0"><joint name="j" axis="0 1 0" range="-10 10" margin=".02"/>'
    world += '<geom size=".1" pos="0 0 .5"/></body>'
    tendon = '<tendon><fixed range="-1 1" margin=".03"><joint joint="j" coef="1"/></fixed></tendon>'
    model, data = compiled(world, tendon, option=option)
    stepper = stepping(model, Moreau(0.5))
    before = model_state(model)
    for _ in range(40):
        stepper.step(data)
        assert_same(model_state(model), before)


def test_the_model_is_what_it_was_after_an_exception_within_a_step():
    model, data = compiled(pile(3).replace("<geom", '<geom margin="0.01" gap="0.005"', 2), option='integrator="RK4"')
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 5)
    before, qpos, qvel, time = model_state(model), data.qpos.copy(), data.qvel.copy(), data.time

    def broken(model, data):
        raise ZeroDivisionError

    mujoco.set_mjcb_control(broken)
    try:
        with pytest.raises(ZeroDivisionError):
            stepper.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert_same(model_state(model), before)
    np.testing.assert_array_equal(data.qpos, qpos)
    np.testing.assert_array_equal(data.qvel, qvel)
    assert data.time == time
    reference = mujoco.MjData(model)
    reference.qpos[:], reference.qvel[:], reference.time = qpos, qvel, time
    stepping(model, Moreau(0.5)).step(reference)
    stepper.step(data)
    assert data.qpos == pytest.approx(reference.qpos, abs=1e-9)


def test_changes_of_the_model_between_steps_take_effect():
    model, data = compiled(FLOOR + box("a", "0 0 .1"), geom='friction="1"', option='gravity="3 0 -9.81"')
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 5)
    assert abs(data.qvel).max() < 1e-9
    model.geom_friction[:, 0] = 0.1
    run(stepper, data, 10)
    assert data.qvel[0] == pytest.approx(10 * 0.002 * (3 - 0.981), abs=1e-9)
    model.opt.gravity[:] = 0, 0, 1.0
    before = data.qvel.copy()
    stepper.step(data)
    assert data.qvel[2] == pytest.approx(0.002, abs=1e-9)
    assert data.qvel[0] == pytest.approx(before[0], abs=1e-9)
    model.opt.timestep = 0.004
    time = data.time
    stepper.step(data)
    assert data.time == pytest.approx(time + 0.004, abs=1e-15)
    model.body_mass[1] *= 4
    model.body_inertia[1] *= 4
    mujoco.mj_setConst(model, mujoco.MjData(model))
    data.xfrc_applied[1, 0] = 8.0
    before = data.qvel[0]
    stepper.step(data)
    assert data.qvel[0] == pytest.approx(before + 0.004 * 8 / 4, abs=1e-9)


@pytest.mark.parametrize("flag", ["CONTACT", "CONSTRAINT", "LIMIT", "GRAVITY", "FRICTIONLOSS", "EQUALITY"])
def test_what_is_disabled_is_off(flag):
    world = (
        FLOOR
        + """<body pos="0 0 .1"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>
        <body pos="3 0 3"><joint name="low" type="slide" axis="0 0 1" range="0 1"/><geom size=".1"/></body>
        <body pos="6 0 3"><joint name="dry" type="slide" axis="0 0 1" frictionloss="1000"/><geom size=".1"/></body>
        <body pos="8 0 3"><joint name="held" type="slide" axis="0 0 1"/><geom size=".1"/></body>"""
    )
    model, data = compiled(world, '<equality><joint joint1="held"/></equality>')
    model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    run(stepping(model, Moreau(0)), data, 50)
    falls = {
        "CONTACT": [1, 0, 0, 0], "CONSTRAINT": [1, 1, 1, 1], "LIMIT": [0, 1, 0, 0], "GRAVITY": [0, 0, 0, 0],
        "FRICTIONLOSS": [0, 0, 1, 0], "EQUALITY": [0, 0, 0, 1],
    }[flag]  # fmt: skip
    fallen = -0.5 * 9.81 * 0.1**2
    assert data.qpos == pytest.approx(fallen * np.array(falls), abs=2e-3)
