"""Many worlds step exactly as single ones, whatever the number of threads."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Coulomb, Fremond, Moreau, Newton, Stepper
from impactlaw.errors import RestitutionError, SceneError, WorldsFailedError

SCENE = """<mujoco><option timestep="0.005"/><worldbody><geom name="floor" type="plane" size="3 3 1" friction=".7"/>
  <body pos="0 0 .4"><freejoint/><geom name="box" type="box" size=".1 .08 .06" condim="4"/></body>
  <body pos=".1 0 .7"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .01 .001"/></body>
  <body pos="-.6 0 .5"><joint name="a" axis="0 1 0" range="-40 40"/><geom name="arm" size=".06" pos=".2 0 0"/></body>
  </worldbody><actuator><motor joint="a" gear="2"/></actuator>
  <keyframe><key name="turned" qpos="0 0 .5 0 1 0 0 .3 0 .9 1 0 0 0 .2"/></keyframe></mujoco>"""
WORLDS = 12


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def _throw(batch: Batch, seed: int = 0) -> np.ndarray:
    """Give each world a velocity of its own, and return the velocities."""
    velocity = np.random.default_rng(seed).normal(size=(batch.nsim, batch.model.nv))
    batch.bind("qvel")[:] = velocity
    return velocity


WAYS: dict[str, Any] = {"rigid": {"scheme": "time-stepping"}, "soft": {"contact_model": "soft"}}
both = pytest.mark.parametrize("contact_model", WAYS)


def _stepped(
    model: mujoco.MjModel, law: Moreau | Newton, velocity: np.ndarray, steps: int, contact_model: str = "rigid"
) -> mujoco.MjData:
    options = WAYS[contact_model] | {"compiled": "never", "on_inadmissible": "project"}
    stepper, data = Stepper(model, law, **options), mujoco.MjData(model)
    data.qvel[:] = velocity
    for _ in range(steps):
        stepper.step(data)
    return data


@pytest.mark.parametrize("nstep", [1, 5])
def test_each_world_is_that_of_a_stepper(model: mujoco.MjModel, nstep: int):
    batch = Batch(model, Moreau(0.5), WORLDS, 2)
    velocity = _throw(batch)
    for _ in range(100 // nstep):
        batch.step(nstep=nstep)
    assert (batch.impact_count > 0).all()
    assert batch.shortfall.max() < 1e-6
    for world in range(WORLDS):
        data = _stepped(model, Moreau(0.5), velocity[world], 100)
        np.testing.assert_allclose(batch.bind("qpos")[world], data.qpos, atol=1e-8)
        np.testing.assert_allclose(batch.bind("qvel")[world], data.qvel, atol=1e-6)
        assert batch.bind("time")[world] == pytest.approx(data.time)


def test_results_do_not_depend_on_threads(model: mujoco.MjModel):
    ends = []
    for threads in (1, 2, 4):
        batch = Batch(model, Moreau(0.5), WORLDS, threads)
        assert batch.nthread == threads
        _throw(batch)
        for _ in range(40):
            batch.step(nstep=3)
        ends.append(batch.state.copy())
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])


@both
def test_worlds_have_laws_and_restitution_of_their_own(model: mujoco.MjModel, contact_model: Any):
    laws = [
        Moreau(0.1),
        Newton({("ball", "floor"): 0.9}, default=0.3),
        Coulomb(Moreau(0.7), tangential_restitution=0.2),
    ]
    batch = Batch(model, laws * 2, 6, 2, contact_model=contact_model)
    velocity = _throw(batch)
    batch.restitution[3] = 0.8
    batch.step(nstep=100)
    own = [*laws, Moreau(0.8), *laws[1:]]
    for world in range(6):
        data = _stepped(model, own[world], velocity[world], 100, contact_model)
        np.testing.assert_allclose(batch.bind("qpos")[world], data.qpos, atol=1e-8)


@both
def test_worlds_have_parameters_of_their_own(model: mujoco.MjModel, contact_model: Any):
    batch = Batch(model, Moreau(0.5), 3, 1, contact_model=contact_model)
    friction = batch.expand("geom_friction")
    friction[1, :, 0] = 0.1
    velocity = np.random.default_rng(3).normal(size=model.nv)
    batch.bind("qvel")[:] = velocity
    batch.step(nstep=150)
    ends = batch.bind("qpos")
    assert np.array_equal(ends[0], ends[2])
    own = mujoco.MjModel.from_xml_string(SCENE)
    own.geom_friction[:, 0] = 0.1
    np.testing.assert_allclose(ends[1], _stepped(own, Moreau(0.5), velocity, 150, contact_model).qpos, atol=1e-8)
    assert np.abs(ends[1] - ends[0]).max() > 1e-3


@both
def test_some_worlds_are_stepped_and_reset(model: mujoco.MjModel, contact_model: Any):
    batch = Batch(model, Moreau(0.5), 4, 2, contact_model=contact_model)
    _throw(batch)
    batch.step(ids=[1, 3], nstep=60)
    assert batch.bind("time") == pytest.approx([0.0, 0.3, 0.0, 0.3])
    kept = batch.state[3].copy()
    batch.reset([1], keyframe=0)
    assert np.array_equal(batch.bind("qpos")[1], model.key_qpos[0])
    assert batch.impact_count[1] == 0
    assert np.array_equal(batch.state[3], kept)
    assert np.array_equal(batch.get_data(3).qpos, batch.bind("qpos")[3])


@both
def test_a_world_fails_alone(model: mujoco.MjModel, contact_model: Any):
    batch, other = (
        Batch(model, Moreau(0.5), 4, 2, contact_model=contact_model),
        Batch(model, Moreau(0.5), 4, 1, contact_model=contact_model),
    )
    _throw(batch)
    _throw(other)
    batch.bind("qvel")[2, 0] = np.nan
    before = batch.state[2].copy()
    with pytest.raises(WorldsFailedError, match=r"^1 world has failed \(2\): .* not finite") as caught:
        batch.step(nstep=50)
    assert list(caught.value.worlds) == [2]
    np.testing.assert_array_equal(batch.state[2], before)
    other.step(nstep=50)
    for world in (0, 1, 3):
        assert np.array_equal(batch.state[world], other.state[world])


@both
def test_an_error_of_the_engine_is_one_of_its_world(contact_model: Any):
    tight = mujoco.MjModel.from_xml_string(SCENE.replace("<worldbody>", '<size memory="14K"/><worldbody>', 1))
    batch = Batch(tight, Moreau(0.5), 3, 1, contact_model=contact_model)
    batch.bind("qpos")[0, 2], batch.bind("qpos")[0, 9] = 30.0, 40.0  # world 0 is far from any contact
    with pytest.raises(WorldsFailedError, match="memory") as caught:
        for _ in range(200):
            before = batch.state.copy()
            batch.step(nstep=2)
    failed = caught.value.worlds
    assert 0 not in failed
    np.testing.assert_array_equal(batch.state[failed], before[failed])


def test_what_a_batch_does_not_take(model: mujoco.MjModel):
    with pytest.raises(SceneError, match="looks at all contacts"):
        Batch(model, Fremond({("box/floor", "ball/floor"): 0.5}), 2)
    with pytest.raises(SceneError, match="need as many laws"):
        Batch(model, [Moreau(0.5)], 2)
    with pytest.raises(RestitutionError, match="no restitution for contacts"):
        Batch(model, Newton({("ball", "floor"): 0.9}), 2, 1)
    batch = Batch(model, Moreau(0.5), 2, 1)
    with pytest.raises(RestitutionError, match="no restitution for contacts"):
        batch.set_law(Newton({("ball", "floor"): 0.9}), [1])
    assert batch.restitution.tolist() == [0.5, 0.5]


def test_fields_of_the_step_are_bound(model: mujoco.MjModel):
    batch = Batch(model, Moreau(0.5), 2, 1)
    place = batch.bind("xpos")
    batch.step(nstep=10)
    data = batch.get_data(1)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(place[1], data.xpos, atol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        place[0] = 0.0
    with pytest.raises(Exception, match="xpo"):
        batch.bind("xpo")


@pytest.mark.parametrize(
    "wrong", [{"nsim": 0}, {"nthread": -1}, {"friction": "x"}, {"on_inadmissible": "x"}, {"rest_speed": -1.0}]
)
def test_options_that_cannot_be_are_refused(wrong):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Batch(model, Moreau(0.5), **{"nsim": 2, **wrong})


TABLE = """<mujoco><option timestep=".004"/><worldbody>
  <body name="table" mocap="true" pos="0 0 -.1"><geom type="box" size=".5 .5 .1" friction=".6"/></body>
  <body pos="0 0 .2"><freejoint/><geom size=".07"/></body>
  <body pos=".2 .1 .1"><freejoint/><geom type="ellipsoid" size=".07 .05 .1" condim="4"/></body></worldbody>
  <keyframe><key time=".004"/></keyframe></mujoco>"""


def _shake(position: np.ndarray, quaternion: np.ndarray, step: int, world: int) -> None:
    """Move the table of a world to its pose at the end of a step."""
    t = 0.004 * step
    position[2] = -0.1 + 0.02 * np.sin((8.0 + world) * t)
    quaternion[:] = np.cos(0.05 * np.sin(3.0 * t)), 0.0, np.sin(0.05 * np.sin(3.0 * t)), 0.0


def test_moving_surfaces_are_those_of_a_stepper():
    model, ends = mujoco.MjModel.from_xml_string(TABLE), []
    for threads in (1, 3):
        batch = Batch(model, Moreau(0.5), 5, threads)
        batch.step(nstep=7)
        batch.reset()
        position, quaternion = batch.bind("mocap_pos"), batch.bind("mocap_quat")
        for step in range(120):
            for world in range(5):
                _shake(position[world, 0], quaternion[world, 0], step, world)
            batch.step()
        assert (batch.impact_count > 1).all()
        ends.append(batch.state.copy())
    assert np.array_equal(*ends)
    for world in range(5):
        stepper, data = Stepper(model, Moreau(0.5), scheme="time-stepping"), mujoco.MjData(model)
        for step in range(120):
            _shake(data.mocap_pos[0], data.mocap_quat[0], step, world)
            stepper.step(data)
        np.testing.assert_allclose(batch.bind("qpos")[world], data.qpos, atol=1e-8)
        np.testing.assert_allclose(batch.bind("qvel")[world], data.qvel, atol=1e-6)


def test_surfaces_of_worlds_that_are_reset_stand_still_first():
    model = mujoco.MjModel.from_xml_string(TABLE)
    batch, fresh = (Batch(model, Moreau(0.5), 2, 1) for _ in range(2))
    batch.bind("mocap_pos")[1, 0, 2] = -0.2
    batch.step()
    assert batch.bind("time")[1] == 0.004
    for one in (batch, fresh):
        one.reset([1], 0)  # to the time at which the step ended
        one.bind("mocap_pos")[1, 0, 2] = -0.05
        one.step([1])
    assert np.array_equal(batch.state[1], fresh.state[1])


def test_forces_on_bodies_are_those_of_one_world_where_somebody_asks(model: mujoco.MjModel):
    batch, stepper = Batch(model, Moreau(0.3), 3, 2), Stepper(model, Moreau(0.3), scheme="time-stepping")
    felt, data, most = batch.bind("cfrc_ext"), mujoco.MjData(model), 0.0
    for _ in range(80):
        batch.step()
        stepper.step(data)
        mujoco.mj_rnePostConstraint(model, data)
        np.testing.assert_allclose(felt, np.broadcast_to(data.cfrc_ext, felt.shape), atol=1e-6)
        most = max(most, float(np.abs(felt).max()))
    assert most > 10.0


@pytest.mark.parametrize("wrong", [3.0, -1.0, np.nan, np.inf])
def test_restitution_that_is_none_is_refused(model: mujoco.MjModel, wrong: float):
    batch = Batch(model, Moreau(0.5), 3)
    before = batch.bind("qpos").copy()
    batch.restitution[1] = wrong
    with pytest.raises(RestitutionError, match="world 1"):
        batch.step()
    np.testing.assert_array_equal(batch.bind("qpos"), before)
    batch.restitution[1] = 0.9
    batch.step()


@both
def test_a_law_of_pairs_takes_the_place_of_another_one(contact_model):
    """The coefficient of the contact has been looked up in the first law before the second one comes."""
    ball = '<body pos="0 0 .2"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="1"/></body>'
    xml = f'<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/>{ball}</worldbody></mujoco>'
    batch = Batch(
        mujoco.MjModel.from_xml_string(xml), Newton({("ball", "floor"): 0.2}), 2, 1, contact_model=contact_model
    )
    height, speed = batch.bind("qpos"), batch.bind("qvel")
    speed[:] = -1.0
    batch.step(nstep=60)
    batch.set_law(Newton({("ball", "floor"): 0.8}), [1])
    height[:], speed[:] = 0.0, -3.0
    batch.step(nstep=40)  # it falls by 0.1 m in 16 steps
    impact = np.sqrt(9.0 + 2 * 9.81 * 0.1)
    rise = speed[:, 0] + 9.81 * (40 * 0.002 - (impact - 3.0) / 9.81)
    np.testing.assert_allclose(rise / impact, [0.2, 0.8], atol=0.01)
