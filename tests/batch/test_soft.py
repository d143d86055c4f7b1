"""Many worlds take soft steps exactly as single ones, whatever the number of threads."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scenes import FALLING, HELD

from impactlaw import Batch, Moreau, Newton, Stepper
from impactlaw.errors import RestitutionError, SceneError
from impactlaw.laws import Reversal
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.soft.scheme import SoftStepping

SCENE = """<mujoco><option timestep="0.005" integrator="{}"/><worldbody>
  <geom name="floor" type="plane" size="3 3 1" friction=".7"/>
  <body pos="0 0 .4"><freejoint/><geom name="box" type="box" size=".1 .08 .06" condim="4"/></body>
  <body pos=".1 0 .7"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .01 .001"/></body>
  <body pos="-.6 0 .5"><joint name="a" axis="0 1 0" range="-40 40"/><geom name="arm" size=".06" pos=".2 0 0"/></body>
  </worldbody><actuator><motor joint="a" gear="2"/></actuator></mujoco>"""
INTEGRATORS = ("Euler", "RK4", "implicitfast")


def compiled(integrator: str = "Euler") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE.format(integrator))


def thrown(batch: Batch) -> np.ndarray:
    """Give each world a velocity of its own, and return the velocities."""
    velocity = np.random.default_rng(0).normal(size=(batch.nsim, batch.model.nv))
    batch.bind("qvel")[:] = velocity
    return velocity


def stepped(model: mujoco.MjModel, law, velocity: np.ndarray, steps: int) -> mujoco.MjData:
    stepper = Stepper(model, law, contact_model="soft", compiled="never", on_inadmissible="project")
    data = mujoco.MjData(model)
    data.qvel[:] = velocity
    for _ in range(steps):
        stepper.step(data)
    return data


@pytest.mark.parametrize("nstep", [1, 5])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_each_world_is_that_of_a_stepper(integrator, nstep):
    model = compiled(integrator)
    batch = Batch(model, Moreau(0.5), 6, 2, contact_model="soft")
    velocity = thrown(batch)
    for _ in range(100 // nstep):
        batch.step(nstep=nstep)
    assert (batch.impact_count > 0).all()
    assert not batch.short_steps.any()
    assert not batch.shortfall.any()
    for world in range(6):
        data = stepped(model, Moreau(0.5), velocity[world], 100)
        np.testing.assert_allclose(batch.bind("qpos")[world], data.qpos, atol=1e-9)
        np.testing.assert_allclose(batch.bind("qvel")[world], data.qvel, atol=1e-8)
        assert batch.bind("time")[world] == pytest.approx(data.time)


def test_worlds_without_a_collision_are_those_of_mujoco():
    model = compiled()
    batch, data = Batch(model, Moreau(0.5), 3, 1, contact_model="soft"), mujoco.MjData(model)
    batch.step(nstep=20)
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert (batch.bind("qpos") == data.qpos).all()
    assert not batch.impact_count.any()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_results_do_not_depend_on_threads(integrator):
    ends = []
    for threads in (1, 2, 4):
        batch = Batch(compiled(integrator), Moreau(0.5), 12, threads, contact_model="soft")
        thrown(batch)
        for _ in range(40):
            batch.step(nstep=3)
        ends.append(batch.state.copy())
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])


def held(law=None, steps: int = 3, **options) -> Batch:
    """Return two worlds; the first step of the second one must be taken in Python."""
    model = mujoco.MjModel.from_xml_string(HELD.format(arm=1))
    batch = Batch(model, law or Moreau(0.0), 2, 1, contact_model="soft")
    for name, values in options.items():
        batch.expand(name)[:] = values
    batch.bind("xpos"), batch.bind("cfrc_ext")
    batch.bind("qvel")[1] = FALLING
    batch.step(nstep=steps)
    return batch


def alone(model: mujoco.MjModel, law, steps: int) -> tuple[mujoco.MjData, int]:
    stepper, data = Stepper(model, law, contact_model="soft", compiled="never"), mujoco.MjData(model)
    data.qvel[:] = FALLING
    for _ in range(steps):
        stepper.step(data)
    mujoco.mj_rnePostConstraint(model, data)
    return data, stepper.short_steps


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("e", [0.0, 0.3])
def test_what_compiled_code_does_not_take_is_stepped_in_python(steps, e, monkeypatch):
    calls, step = [], SoftStepping.step
    with monkeypatch.context() as patched:
        patched.setattr(SoftStepping, "step", lambda *args: (calls.append(args), step(*args))[1])
        batch = held(Moreau(e), steps)
    assert calls
    assert batch.impact_count.tolist() == [0, 1]
    data, short = alone(batch.model, Moreau(e), steps)
    np.testing.assert_allclose(batch.bind("qpos")[1], data.qpos, atol=1e-12)
    np.testing.assert_allclose(batch.bind("qvel")[1], data.qvel, atol=1e-9)
    np.testing.assert_allclose(batch.bind("xpos")[1], data.xpos, atol=1e-12)
    np.testing.assert_allclose(batch.bind("cfrc_ext")[1], data.cfrc_ext, atol=1e-6)
    assert batch.short_steps.tolist() == [0, short]
    assert batch.bind("time").tolist() == [steps * batch.model.opt.timestep] * 2


def test_steps_in_python_have_the_parameters_and_the_restitution_of_their_world():
    model = mujoco.MjModel.from_xml_string(HELD.format(arm=1))
    light, heavy = model.body_mass.copy(), 3.0 * model.body_mass
    batch = held(Moreau(0.0), 1, body_mass=np.array([light, heavy]))
    assert abs(batch.bind("qvel")[1] - alone(model, Moreau(0.0), 1)[0].qvel).max() > 1e-3
    model.body_mass[:] = heavy
    np.testing.assert_allclose(batch.bind("qvel")[1], alone(model, Moreau(0.0), 1)[0].qvel, atol=1e-9)
    batch = held(steps=1)
    batch.reset()
    batch.bind("qvel")[1] = FALLING
    batch.restitution[1] = 0.3
    batch.step()
    np.testing.assert_allclose(batch.bind("qvel")[1], alone(batch.model, Moreau(0.3), 1)[0].qvel, atol=1e-9)


def test_a_contact_that_the_law_does_not_know_leaves_worlds_as_they_were(monkeypatch):
    model = compiled()
    batch = Batch(model, Newton({("ball", "floor"): 0.9}, default=0.3), 2, 1, contact_model="soft")
    thrown(batch)
    before = batch.state.copy()

    def unknown(table: Coefficients, key: int) -> None:
        raise RestitutionError("no restitution")

    monkeypatch.setattr(Coefficients, "learn", unknown)
    with pytest.raises(RestitutionError, match="no restitution"):
        batch.step(nstep=100)
    np.testing.assert_array_equal(batch.state, before)


MOVED = """<mujoco><worldbody><body name="table" mocap="true"><geom type="box" size=".5 .5 .1"/></body>
  <body pos="0 0 .2"><freejoint/><geom size=".07"/></body></worldbody></mujoco>"""


def test_what_a_soft_batch_does_not_take():
    with pytest.raises(SceneError, match="looks at all contacts"):
        Batch(compiled(), Reversal(0.5), 2, contact_model="soft")
    with pytest.raises(SceneError, match="discrete"):
        Batch(compiled("discrete"), Moreau(0.5), 2, contact_model="soft")
    with pytest.raises(SceneError, match="mocap bodies"):
        Batch(mujoco.MjModel.from_xml_string(MOVED), Moreau(0.5), 2, contact_model="soft")
    with pytest.raises(ValueError, match="contact_model"):
        Batch(compiled(), Moreau(0.5), 2, contact_model="hard")
    with pytest.raises(SceneError, match="on_inadmissible means nothing"):
        Batch(compiled(), Moreau(0.5), 2, contact_model="soft", on_inadmissible="raise")


@pytest.mark.parametrize("option", [{"friction": "convex"}, {"friction": "ignore"}, {"rest_speed": 3.0}], ids=str)
def test_options_change_what_happens(option):
    ends = []
    for options in ({}, option):
        batch = Batch(compiled(), Moreau(0.5), 2, 1, contact_model="soft", **options)
        batch.bind("qvel")[:, :6] = 9.0, 0.0, -0.5, 0.0, 0.0, 3.0
        batch.step(nstep=120)
        ends.append(batch.state.copy())
    assert np.abs(ends[0] - ends[1]).max() > 1e-5


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_what_mujoco_cannot_make_a_batch_of_is_refused(contact_model):
    sleeping = mujoco.MjModel.from_xml_string('<mujoco><option><flag sleep="enable"/></option></mujoco>')
    with pytest.raises(SceneError, match="sleep"):
        Batch(sleeping, Moreau(0.5), 2, contact_model=contact_model)


@pytest.mark.parametrize("height", [0.1, 0.08])
def test_a_state_that_is_written_between_rk4_steps_is_taken_as_it_is(height):
    """The last step ended without contact; the written position touches the floor at the start of the next step."""
    xml = """<mujoco><option integrator="RK4"/><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 1"><freejoint/><geom size=".1" condim="1"/></body></worldbody></mujoco>"""
    batch = Batch(mujoco.MjModel.from_xml_string(xml), Moreau(1.0), 2, 1, contact_model="soft")
    batch.step()
    batch.bind("qpos")[1, 2], batch.bind("qvel")[1, 2] = height - 1e-6, -3.0
    batch.step()
    assert batch.impact_count.tolist() == [0, 1]
    assert batch.bind("qvel")[1, 2] == pytest.approx(3.0, abs=0.03)
