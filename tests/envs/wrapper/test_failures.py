"""Errors of an environment, a law or a state under the wrapper are reported, or end the episode."""

import gymnasium
import mujoco
import numpy as np
import pytest
from wrapped import (
    Falling,
    assert_equal,
    assert_plain,
    data_of,
    hopper,
    make_any,
    split_info,
    theirs,
)

from impactlaw import LinearMap
from impactlaw.envs import ImpactLaw
from impactlaw.errors import (
    InadmissibleImpactError,
    RecordingError,
    RestitutionError,
    SceneError,
    UnknownNameError,
    WrapperError,
)

pytestmark = theirs


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", ["Hopper-v5", "HalfCheetah-v5", ("walker", "walk"), ("hopper", "hop")], ids=str)
@pytest.mark.parametrize("steps", [0, 3])
@pytest.mark.parametrize("field", ["qpos", "qvel", "qfrc_applied"])
def test_divergence_ends_the_episode(name, steps, field):
    env = ImpactLaw(make_any(name), "moreau", 0.5)
    env.action_space.seed(0)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        for _ in range(steps):
            observation, *_ = env.step(env.action_space.sample())
        getattr(data_of(env), field)[0] = 1e200 if field == "qfrc_applied" else np.nan
        last, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert info["impact/diverged"] == 1
        assert_plain(split_info(info)[1])
        assert (reward, terminated, truncated) == (0.0, False, True)
        assert_equal(last, observation)
        data_of(env).qfrc_applied[0] = 0.0
    env.reset(seed=0)
    assert env.step(env.action_space.sample())[4]["impact/diverged"] == 0


class TwoRewards(gymnasium.RewardWrapper):
    """Rewards of several objectives, as those of mo-gymnasium."""

    def reward(self, reward):
        return np.array([reward, 1.0], dtype=np.float32)


def test_a_reward_of_several_objectives_has_as_many_zeros_after_divergence():
    env = ImpactLaw(TwoRewards(gymnasium.make("Hopper-v5")), "moreau", 0.5)
    env.reset(seed=0)
    env.step(np.zeros(3))
    _, reward, _, truncated, _ = env.step(np.full(3, np.nan))
    assert truncated
    assert isinstance(reward, np.ndarray)
    assert (reward.tolist(), reward.dtype) == ([0.0, 0.0], np.float32)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", ["Hopper-v5", "Ant-v5", "HalfCheetah-v5"])
def test_a_force_of_any_size_moves_or_diverges(name):
    """Velocities may be finite but too large to be squared, in a collision before MuJoCo notices."""
    env = ImpactLaw(gymnasium.make(name), "moreau", 0.5)
    env.action_space.seed(0)
    for trial in range(60):
        env.reset(seed=trial)
        for _ in range(trial % 7):
            env.step(env.action_space.sample())
        data = data_of(env)
        data.qfrc_applied[trial % 3] = 10.0 ** (8 + 5 * trial)
        diverged = env.step(env.action_space.sample())[-1]["impact/diverged"]
        assert diverged or np.abs(data.qvel).max() <= mujoco.mjMAXVAL
        data.qfrc_applied[:] = 0.0


@pytest.mark.usefixtures("quiet")
def test_rk4_diverging_in_a_last_timestep_is_seen_at_once():
    """MuJoCo itself checks the result of RK4 only at the start of the next timestep."""
    env = hopper()
    observation, _ = env.reset(seed=0)
    env.unwrapped.frame_skip = 1

    def break_later_stages(_model, data):
        if data.time > 0:
            data.qfrc_passive[0] = np.nan

    mujoco.set_mjcb_passive(break_later_stages)
    try:
        last, *_, truncated, info = env.step(np.zeros(3))
    finally:
        mujoco.set_mjcb_passive(None)
    assert truncated
    assert info["impact/diverged"] == 1
    assert_equal(last, observation)


def test_other_errors_pass_through():
    env = hopper()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="dimension"):
        env.step(np.zeros(7))
    env = ImpactLaw(Falling(), LinearMap(-1.5 * np.eye(6)), friction="ignore", on_inadmissible="raise")
    env.reset(seed=0)
    with pytest.raises(InadmissibleImpactError):
        for _ in range(300):
            env.step(np.zeros(0))


class StepsItself(Falling):
    def _step_mujoco_simulation(self, ctrl, n_frames):
        self.data.time += 1.0


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: gymnasium.make("CartPole-v1"), r"CartPoleEnv does not step MuJoCo in a way.*call impactlaw\.Stepper"),
        (lambda: gymnasium.make("impactlaw/NewtonsCradle-v0"), "takes its law as an argument"),
        (StepsItself, "StepsItself steps MuJoCo in a way of its own"),
    ],
)
def test_an_environment_that_does_not_step_mujoco(make, reason):
    with pytest.raises(WrapperError, match=reason):
        ImpactLaw(make(), "moreau", 0.5)


def test_the_name_of_an_environment():
    with pytest.raises(WrapperError, match=r"got 'Hopper-v5'; make it with gymnasium\.make\('Hopper-v5'\)"):
        ImpactLaw("Hopper-v5", "moreau", 0.5)  # pyright: ignore[reportArgumentType]


class StepsInDoSimulation(Falling):
    def do_simulation(self, ctrl, n_frames):
        mujoco.mj_step(self.model, self.data, n_frames)


class StepsInStep(Falling):
    def step(self, action):
        mujoco.mj_step(self.model, self.data, self.frame_skip)
        return self.data.qpos.copy(), 0.0, False, False, {}


@pytest.mark.parametrize("kind", [StepsInDoSimulation, StepsInStep])
def test_an_environment_that_steps_past_the_law(kind):
    env = ImpactLaw(kind(), "moreau", 0.5)
    env.reset(seed=0)
    with pytest.raises(WrapperError, match=r"a way of its own.*: the law has no effect; call impactlaw\.Stepper"):
        env.step(np.zeros(0))


class SettlesInStep(Falling):
    def step(self, action):
        if self.data.time > 0.0:
            mujoco.mj_step(self.model, self.data)
            return self.data.qpos.copy(), 0.0, False, False, {}
        return super().step(action)


def test_time_may_pass_without_the_law_where_it_has_stepped_before():
    env = ImpactLaw(SettlesInStep(), "moreau", 0.5)
    for seed in range(2):
        env.reset(seed=seed)
        for _ in range(3):
            env.step(np.zeros(0))


@pytest.mark.parametrize(
    ("law", "options", "error"),
    [
        ("moro", {"restitution": 0.5}, UnknownNameError),
        ("moreau", {}, RestitutionError),
        ("moreau", {"restitution": 1.5}, RestitutionError),
        ("scene", {}, RestitutionError),
        ("moreau", {"restitution": 0.5, "contact_model": "hard"}, UnknownNameError),
        ("newton", {"restitution": {("floor", "foot"): 0.5}}, UnknownNameError),
        ("moreau", {"restitution": 0.5, "log": "/proc/no/run.rrd"}, RecordingError),
    ],
)
def test_wrong_arguments_are_one_clear_error(law, options, error):
    env = gymnasium.make("Hopper-v5")
    with pytest.raises(error):
        ImpactLaw(env, law, **options)
    assert "_step_mujoco_simulation" not in vars(env.unwrapped)


def test_located_contacts_refuse_adhesion():
    class Sticking(Falling):
        def _initialize_simulation(self):
            adhesion = '<actuator><adhesion body="ball" ctrlrange="0 1"/></actuator></mujoco>'
            xml = self._xml.replace("<body", '<body name="ball"').replace("</mujoco>", adhesion)
            model = mujoco.MjModel.from_xml_string(xml)
            return model, mujoco.MjData(model)

    with pytest.raises(SceneError, match="adhesion"):
        ImpactLaw(Sticking(), "moreau", 0.5, contact_model="rigid", scheme="event-driven")


@pytest.mark.parametrize("contact_model", ["soft", "rigid"])
@pytest.mark.parametrize("own", [False, True])
def test_a_step_that_diverges_tells_no_collisions_recorded_or_not(tmp_path, contact_model, own):
    told = []
    for log in (None, tmp_path / "run.rrd"):
        options = {"law": "moreau", "restitution": 0.5, "contact_model": contact_model, "log": log}
        plain = None if own else gymnasium.make("Hopper-v5")
        env = gymnasium.make("impactlaw/Juggler-v0", **options) if plain is None else ImpactLaw(plain, **options)
        env.reset(seed=0)
        data = env.unwrapped.data
        data.qpos[0 if own else 1] = 0.001 if own else 1.2
        data.qvel[0 if own else 1] = -5.0
        begun = data.time

        def break_later(_, data, begun=begun):
            if data.time > begun + 0.0035:
                data.qfrc_applied[:] = np.nan

        mujoco.set_mjcb_control(break_later)
        try:
            info = env.step(np.zeros(env.action_space.shape, np.float32))[4]
        finally:
            mujoco.set_mjcb_control(None)
        told.append(info)
        env.close()
    assert told[0] == told[1]
    assert told[0]["impact/diverged"] == 1
    assert told[0]["impact/count"] == told[0]["impact/energy_change"] == 0
