"""A state that is restored in data with frames of another state: no wall is passed."""

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Newton, Stepper

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WALL = """<mujoco><option timestep=".005" gravity="0 0 0"/><worldbody><geom type="box" size=".002 1 1"/>
  <body pos="-.5 0 0"><freejoint/><geom size=".02" condim="1"/></body></worldbody></mujoco>"""
_ROPE = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="3 3 1"/>
  <site name="top" pos="0 0 2"/>
  <body pos="0 0 1"><freejoint/><geom size=".05" mass="1"/><site name="bob"/></body>
  <body pos="2 0 .1"><freejoint/><geom name="ball" size=".05"/></body></worldbody>
  <tendon><spatial range="0 1" limited="true"><site site="top"/><site site="bob"/></spatial></tendon></mujoco>"""


@pytest.mark.parametrize("through", ["reset", "kinematics", "other data", "another state"])
def test_thin_wall_is_not_passed(through: str) -> None:
    model = mujoco.MjModel.from_xml_string(_WALL)
    stepper, data = Stepper(model, Moreau(1.0), scheme="time-stepping"), mujoco.MjData(model)
    data.qvel[0] = 20.0
    while data.qpos[0] < -0.11:
        stepper.step(data)
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    if through == "other data":
        data = mujoco.MjData(model)
    elif through == "another state":
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
    else:
        mujoco.mj_resetData(model, data)
    mujoco.mj_setState(model, data, state, _STATE)
    if through == "kinematics":
        mujoco.mj_kinematics(model, data)
    for _ in range(20):
        stepper.step(data)
    assert data.qpos[0] < -0.5
    assert data.qvel[0] == pytest.approx(-20.0)


@pytest.mark.parametrize("nstep", [1, 5])
def test_first_run_is_as_the_second_that_knows_all_contacts(nstep: int) -> None:
    model = mujoco.MjModel.from_xml_string(_ROPE)
    batch, runs = Batch(model, Newton({("floor", "ball"): 0.5}, default=0.0), 1, 1), []
    for _ in range(2):
        batch.reset()
        batch.bind("qvel")[:, 0] = 2.0
        run = []
        for _ in range(200 // nstep):
            batch.step(nstep=nstep)
            run.append(batch.bind("qpos").copy())
        runs.append(run)
    np.testing.assert_array_equal(*runs)
