"""The wrapper with others: copies, vector environments, limits, unwrapping, new models, recordings."""

import copy
import functools
import pickle
import warnings

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import suite
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit
from wrapped import INFO, Falling, drop, hopper, theirs

from impactlaw import Moreau
from impactlaw.envs import ImpactLaw, put_law
from impactlaw.errors import WrapperError
from impactlaw.recording import read_log

pytestmark = theirs


def rollout(env, steps=120, seed=5):
    """Return observations, rewards and the collisions of the law, from a reset on."""
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    rows, counts = [np.append(observation, 0.0)], [info["impact/count"]]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rows.append(np.append(observation, reward))
        counts.append(info["impact/count"])
        if terminated or truncated:
            env.reset()
    assert sum(counts) > 0
    return np.array(rows), counts


@pytest.mark.parametrize(
    "duplicate",
    [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env)), lambda env: gymnasium.make(env.spec)],
    ids=["deepcopy", "pickle", "spec"],
)
@pytest.mark.parametrize("where", ["outside", "inside"])
def test_a_copy_keeps_the_law(duplicate, where):
    env = hopper()
    if where == "inside":
        env = TimeLimit(RecordEpisodeStatistics(env), 50)
    rollout(env, 30)
    rows, counts = rollout(duplicate(env))
    wanted, wanted_counts = rollout(env)
    np.testing.assert_array_equal(rows, wanted)
    assert counts == wanted_counts


def test_a_shallow_copy_leaves_the_law_where_it_is():
    env = hopper()
    env.reset(seed=0)
    twin = copy.copy(env)
    twin.law = Moreau(0.25)
    assert twin.env is env.env
    for one in (env, twin):
        assert one.step(np.zeros(3))[4]["impact/restitution"] == 0.25


def test_a_copy_of_an_environment_that_is_copied_as_it_stands():
    """Not every environment is rebuilt by its constructor; stepping the copy must not step the original."""
    env = ImpactLaw(Falling(), "moreau", 0.5)
    env.reset(seed=0)
    twin = copy.deepcopy(env)
    before = env.unwrapped.data.qpos.copy()
    for _ in range(200):
        twin.step(np.zeros(0))
    np.testing.assert_array_equal(env.unwrapped.data.qpos, before)
    assert twin.unwrapped.data.time == pytest.approx(0.4)
    twin.remove()
    assert "_step_mujoco_simulation" not in vars(twin.unwrapped)
    assert "_step_mujoco_simulation" in vars(env.unwrapped)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments(mode):
    single = [hopper() for _ in range(2)]
    kind = SyncVectorEnv if mode == "sync" else functools.partial(AsyncVectorEnv, context="forkserver")
    vector = kind([hopper] * 2, autoreset_mode=AutoresetMode.NEXT_STEP)
    try:
        observation, info = vector.reset(seed=[3, 4])
        np.testing.assert_array_equal(observation, [env.reset(seed=3 + i)[0] for i, env in enumerate(single)])
        for name in INFO:
            np.testing.assert_array_equal(info[f"impact/{name}"], [0, 0])
        vector.action_space.seed(0)
        over, total = [False, False], 0
        for _ in range(60):
            actions = vector.action_space.sample()
            observation, _, terminated, truncated, info = vector.step(actions)
            for i, env in enumerate(single):
                if over[i]:
                    wanted, wanted_info = env.reset()
                else:
                    wanted, _, _, _, wanted_info = env.step(actions[i])
                np.testing.assert_array_equal(observation[i], wanted)
                for name in INFO:
                    assert info[f"impact/{name}"][i] == wanted_info[f"impact/{name}"]
                    assert info[f"impact/{name}"].dtype.kind in "if"
                total += wanted_info["impact/count"]
            over = terminated | truncated
        assert total > 0
    finally:
        vector.close()


def test_make_vec_takes_the_wrapper():
    law = functools.partial(ImpactLaw, law="moreau", restitution=0.5)
    vector = gymnasium.make_vec("Hopper-v5", num_envs=2, vectorization_mode="sync", wrappers=[law])
    vector.reset(seed=0)
    assert "impact/count" in vector.step(vector.action_space.sample())[4]
    vector.close()


def test_time_limit_and_statistics():
    env = RecordEpisodeStatistics(TimeLimit(ImpactLaw(gymnasium.make("HalfCheetah-v5"), "moreau", 0.5), 25))
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for i in range(25):
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total += reward
        assert truncated == (i == 24)
        assert not terminated
    assert info["episode"]["l"] == 25
    assert info["episode"]["r"] == pytest.approx(total)
    assert "impact/count" in info


def test_the_law_can_be_taken_off_again():
    env = hopper()
    rollout(env)
    bare, removed = gymnasium.make("Hopper-v5"), env.remove()
    assert removed is env.env
    assert env.law is None
    assert env.events == ()
    assert "_step_mujoco_simulation" not in vars(removed.unwrapped)
    for stepped in (removed, env):
        (a, _), (b, _) = stepped.reset(seed=1), bare.reset(seed=1)
        bare.action_space.seed(1)
        for _ in range(40):
            action = bare.action_space.sample()
            (a, *_, info), (b, *_) = stepped.step(action), bare.step(action)
            np.testing.assert_array_equal(a, b)
            assert not any(key.startswith("impact/") for key in info)
    env.remove()
    assert copy.deepcopy(env).law is None
    again = ImpactLaw(removed, "moreau", 0.0)
    assert again.law == Moreau(0.0)
    rollout(again)


def test_no_two_laws():
    env = hopper()
    for outer in (env, TimeLimit(env, 10), env.unwrapped):
        with pytest.raises(WrapperError, match=r"has the law Moreau\(restitution=0.5\) already; .*remove"):
            ImpactLaw(outer, "moreau", 0.9)
    task = suite.load("hopper", "hop")
    put_law(task, "moreau", 0.5)
    with pytest.raises(WrapperError, match="already"):
        put_law(task, "moreau", 0.5)
    other = gymnasium.make("Hopper-v5")
    other.unwrapped._step_mujoco_simulation = print
    with pytest.raises(WrapperError, match="was replaced already"):
        ImpactLaw(other, "moreau", 0.5)


def test_a_new_model_gets_a_new_stepper():
    env = hopper()
    env.reset(seed=0)
    base = env.unwrapped
    heavier = mujoco.MjModel.from_xml_path(base.fullpath)
    heavier.body_mass *= 3
    base.model, base.data = heavier, mujoco.MjData(heavier)
    env.reset(seed=0)
    while not env.events:
        env.step(env.action_space.sample())
    wanted = np.zeros((heavier.nv, heavier.nv))
    data = mujoco.MjData(heavier)
    data.qpos[:] = env.events[0].qpos
    mujoco.mj_forward(heavier, data)
    mujoco.mj_fullM(heavier, data, wanted)
    np.testing.assert_allclose(env.events[0].impact.collision.mass_matrix, wanted, rtol=1e-9, atol=1e-12)


class _OtherFloor(HopperEnv):
    """A task whose reset compiles a model with another restitution."""

    def reset(self, *, seed=None, options=None):
        spec = mujoco.MjSpec.from_file(self.fullpath)
        spec.add_numeric(name="restitution", data=[0.25 if seed is None else 0.5])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        return super().reset(seed=seed, options=options)


def test_stepper_and_law_after_a_reset_are_those_of_its_model():
    spec = mujoco.MjSpec.from_file(HopperEnv().fullpath)
    spec.add_numeric(name="restitution", data=[0.75])
    plain = _OtherFloor()
    plain.model = spec.compile()
    plain.data = mujoco.MjData(plain.model)
    env = ImpactLaw(plain, "scene")
    for seed, restitution in ((0, 0.5), (None, 0.25)):
        _, info = env.reset(seed=seed)
        stepper = env.stepper
        assert stepper is not None
        assert stepper.model is plain.model
        assert info["impact/restitution"] == restitution
        env.step(env.action_space.sample())
        assert env.stepper is stepper
        plain.model.numeric_data[-1] = 0.875  # as randomization in the middle of an episode
        *_, info = env.step(env.action_space.sample())
        assert info["impact/restitution"] == env.law.default == 0.875


@pytest.mark.parametrize("name", ["Hopper-v5", "HalfCheetah-v5"])
def test_check_env(name):
    env = ImpactLaw(gymnasium.make(name), "moreau", 0.5)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        warnings.filterwarnings("ignore", message=".*Box observation space (minimum|maximum) value is -?infinity.*")
        check_env(env, skip_render_check=True)


def test_a_log_holds_what_happened(tmp_path):
    env = hopper(log=tmp_path / "run.rrd")
    twin = copy.deepcopy(env)
    events = []
    env.reset(seed=11)
    env.action_space.seed(0)
    for _ in range(100):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        events += env.events
        if terminated or truncated:
            env.reset()
    twin.reset(seed=0)
    twin.step(twin.action_space.sample())
    env.close()
    log = read_log(tmp_path / "run.rrd")
    assert len(events) > 3
    assert len(log.collisions) == len(events)
    np.testing.assert_array_equal(log.collisions["energy_change"], [event.impact.energy_change for event in events])
    assert log.properties["scene"] == "Hopper-v5"
    assert log.properties["seed"] == 11
    assert "Moreau" in log.properties["law"]
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_a_log_per_model(tmp_path):
    env = drop()
    placed = put_law(env, "moreau", 0.5, log=tmp_path / "run.rrd")
    for _ in range(2):
        env.reset()
        for _ in range(50):
            env.step([])
    placed.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run-2.rrd", "run.rrd"]
    for path in tmp_path.iterdir():
        assert len(read_log(path).collisions) > 0


@pytest.mark.parametrize("where", ["inside", "outside"])
def test_a_copy_whose_first_step_leaves_the_finite_numbers_observes_what_was_there_before(where):
    env = gymnasium.make("Hopper-v5")
    env = ImpactLaw(TimeLimit(env, 10), "moreau", 0.5) if where == "outside" else TimeLimit(hopper(), 10)
    env.reset(seed=0)
    env.step(np.zeros(3))
    twin = copy.deepcopy(env)
    bad = np.full(3, np.nan)
    np.testing.assert_array_equal(twin.step(bad)[0], env.step(bad)[0])
