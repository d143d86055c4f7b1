"""What data and steppers hold between steps: times of derived fields, restored states, copies."""

from __future__ import annotations

import copy
import pickle

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Stepper

WAYS = {
    "soft": {"contact_model": "soft"},
    "time-stepping": {"scheme": "time-stepping"},
    "event-driven": {},
}
every_way = pytest.mark.parametrize("way", WAYS)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_SCENE = """<mujoco><option timestep=".004"><flag energy="enable"/></option><worldbody>
  <geom type="plane" size="3 3 1"/>
  <body pos="0 0 .4"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
    <geom type="capsule" size=".05" fromto="0 0 0 .2 0 0"/>
    <body pos=".2 0 0"><joint name="knee" axis="0 1 0" range="-60 60"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .2 0 -.1"/></body></body>
  </worldbody><actuator><motor joint="knee" gear="4"/></actuator>
  <sensor><jointpos joint="knee"/><jointvel joint="knee"/></sensor></mujoco>"""


def go_on(stepper, data, steps, phase=0):
    """Step under a motor, and return all velocities."""
    seen = []
    for i in range(steps):
        data.ctrl[0] = np.sin(0.1 * (phase + i))
        stepper.step(data)
        seen.append(data.qvel.copy())
    return np.array(seen)


def state_of(model, data):
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state


@every_way
def test_times_of_derived_fields(way):
    """As the page of stepping tells them, in a step without contact."""
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data, stepper, h = mujoco.MjData(model), Stepper(model, Moreau(0.3), **WAYS[way]), model.opt.timestep
    go_on(stepper, data, 20)
    start = copy.copy(data)
    mujoco.mj_forward(model, start)
    go_on(stepper, data, 1, 20)
    end = copy.copy(data)
    mujoco.mj_forward(model, end)
    timed, rigid = "scheme" in WAYS[way], way != "soft"
    np.testing.assert_array_equal(data.xpos, (end if rigid else start).xpos)
    np.testing.assert_array_equal(data.M, (end if rigid else start).M)
    for field in ("cvel", "energy"):
        np.testing.assert_array_equal(getattr(data, field), getattr((end if timed else start), field))
    middle = start.qpos[2] + 0.5 * h * start.qvel[2]
    assert data.sensordata[0] == pytest.approx(middle if timed else start.qpos[2], abs=1e-14)
    assert data.sensordata[1] == start.qvel[2]


@every_way
def test_rollouts_from_a_state_do_not_depend_on_those_before(way):
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data, stepper, states = mujoco.MjData(model), Stepper(model, Moreau(0.3), **WAYS[way]), []
    touching = 0
    for i in range(6):
        go_on(stepper, data, 30, 30 * i)
        states.append(state_of(model, data))
        touching += data.ncon > 0
    assert touching > 0
    go_on(stepper, data, 1)  # from where the last step has ended, the stepper would go on with what it remembers
    for state in (*states[::-1], *states):
        other = mujoco.MjData(model)
        mujoco.mj_setState(model, other, state, _STATE)
        mujoco.mj_setState(model, data, state, _STATE)
        wanted = go_on(Stepper(model, Moreau(0.3), **WAYS[way]), other, 8)
        np.testing.assert_array_equal(go_on(stepper, data, 8), wanted)


@pytest.mark.parametrize("resets", [True, False])
def test_rollouts_of_worlds_from_where_one_of_them_is(resets):
    """A world that was reset begins as the others do, not with the memory of the step that led there."""
    batch, same = Batch(mujoco.MjModel.from_xml_string(_SCENE), Moreau(0.3), 2), []
    for i in range(12):
        batch.bind("ctrl")[:, 0] = np.sin(i)
        batch.step([0], nstep=15)
        state = batch.state[0].copy()
        if resets:
            batch.reset()
        batch.state[:] = state
        batch.step(nstep=8)
        same.append(np.array_equal(*batch.state))
        batch.state[0] = state
    assert all(same) is resets


@every_way
@pytest.mark.parametrize("through", ["copy", "pickle", "state"])
def test_checkpoints(way, through):
    """A copy of stepper and data goes on bit for bit, and so does a soft run whose state is restored."""
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data, stepper, touching = mujoco.MjData(model), Stepper(model, Moreau(0.3), **WAYS[way]), 0
    for i in range(6):
        go_on(stepper, data, 30, 30 * i)
        touching += data.ncon > 0
        if through == "state":
            twin, other = Stepper(model, Moreau(0.3), **WAYS[way]), mujoco.MjData(model)
            mujoco.mj_setState(model, other, state_of(model, data), _STATE)
        else:
            twin, other = (copy.deepcopy if through == "copy" else _pickled)((stepper, data))
        found, wanted = go_on(twin, other, 8), go_on(stepper, data, 8)
        if way == "soft" or through != "state":
            np.testing.assert_array_equal(found, wanted)
        else:
            assert found == pytest.approx(wanted, abs=1e-2)
    assert touching > 0


def _pickled(things):
    return pickle.loads(pickle.dumps(things))
