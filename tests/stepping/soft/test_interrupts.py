"""Interrupts and errors in soft steps in Python: one that has not ended is undone."""

from unittest.mock import patch

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Newton, Stepper
from impactlaw.errors import RestitutionError
from impactlaw.stepping.soft import scheme

SCENE = """<mujoco><option timestep=".005" integrator="{}"/><worldbody><geom type="plane" size="3 3 1" friction=".7"/>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .08 .06"/></body>
  <body pos=".1 0 .5"><freejoint/><geom size=".07"/>
  <body><joint axis="0 1 0" range="-5 5" damping=".1"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body>
  </body></worldbody></mujoco>"""


def step(stepper, data):
    stepper.step(data)


def in_halves(stepper, data):
    mujoco.mj_step1(stepper.model, data)
    stepper.finish_step(data)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("advance", [step, in_halves])
def test_interrupts_before_the_end_of_a_step(advance, integrator):
    """They come after the forces are known, or after the law has changed the velocity, in every fifth step."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(integrator))
    options = {"contact_model": "soft", "compiled": "never"}
    (stepper, data), (other, alike) = [(Stepper(model, Moreau(0.6), **options), mujoco.MjData(model)) for _ in range(2)]
    data.qvel[:] = alike.qvel[:] = np.random.default_rng(0).normal(size=13)
    last = (mujoco, "mj_step2") if advance is in_halves and integrator != "RK4" else (scheme, "mj_checkAcc")
    places, collided = (last, (scheme, "bounces")), 0
    for i in range(150):
        advance(other, alike)
        collided += len(other.events)
        before, interrupts = (data.time, *data.qpos, *data.qvel, *data.qacc_warmstart), 0
        for place in places if i % 5 == 0 else ():
            with patch.object(*place, side_effect=KeyboardInterrupt):
                try:
                    advance(stepper, data)
                except KeyboardInterrupt:
                    interrupts += 1
            if data.time > before[0]:
                break
            assert (data.time, *data.qpos, *data.qvel, *data.qacc_warmstart) == before
        assert interrupts or i % 5
        if data.time == before[0]:
            advance(stepper, data)
        np.testing.assert_array_equal((data.time, *data.qpos, *data.qvel), (alike.time, *alike.qpos, *alike.qvel))
    assert collided > 10


def test_errors_of_laws_leave_the_state():
    def fails(speed):
        calls.append(speed)
        raise ZeroDivisionError

    calls, model = [], mujoco.MjModel.from_xml_string(SCENE.format("Euler"))
    data = mujoco.MjData(model)
    stepper = Stepper(model, Newton(fails), contact_model="soft", compiled="never")
    with pytest.raises(RestitutionError, match="cannot be computed"):
        while not calls:
            before = (data.time, *data.qpos, *data.qvel, *data.qacc_warmstart)
            stepper.step(data)
    assert (data.time, *data.qpos, *data.qvel, *data.qacc_warmstart) == before
