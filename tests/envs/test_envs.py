"""Every registered environment obeys gymnasium's API and the conventions of this package."""

import copy
import pickle
import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from own_envs import IDS, INFO, bare, every_env

import impactlaw.envs
from impactlaw.errors import ActionError, ImpactLawError, RestitutionError, SceneError, UnknownNameError
from impactlaw.laws import (
    AnyOutcome,
    Compliant,
    Fremond,
    MaximalDissipation,
    Moreau,
    Newton,
    Poisson,
    Reversal,
    Scattered,
)


def rollout(env, steps, seed=0, actions_seed=0):
    """Return observations, rewards and infos of random actions, across ends of episodes."""
    rng = np.random.default_rng(actions_seed)
    observation, info = env.reset(seed=seed)
    seen = [(observation, 0.0, info)]
    for _ in range(steps):
        action = rng.uniform(env.action_space.low, env.action_space.high)
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation, reward, info))
        if terminated or truncated:
            observation, info = env.reset()
            seen.append((observation, 0.0, info))
    return seen


def same(a, b) -> bool:
    return len(a) == len(b) and all(np.array_equal(x[0], y[0]) and x[1:] == y[1:] for x, y in zip(a, b, strict=True))


# Registration


def test_the_environments_are_these():
    assert [name.removeprefix("impactlaw/") for name in IDS] == [
        "Billiards-v0",
        "Juggler-v0",
        "NewtonsCradle-v0",
        "RockingBlock-v0",
    ]


@every_env
def test_docstring_tables_are_the_spaces(name):
    env = bare(name)
    row = re.compile(r"^\s*\| (\d+)(?:-(\d+))? \|.*\| ([-.\d]+) \.\. ([-.\d]+) \|$", re.MULTILINE)
    rows = [(int(a), int(b or a), float(low), float(high)) for a, b, low, high in row.findall(type(env).__doc__ or "")]
    first_action = max(i for i, r in enumerate(rows) if r[0] == 0)
    for part, space in ((rows[:first_action], env.observation_space), (rows[first_action:], env.action_space)):
        assert [r[0] for r in part] == [0] + [r[1] + 1 for r in part[:-1]]
        low = np.concatenate([np.full(b - a + 1, low) for a, b, low, _ in part])
        high = np.concatenate([np.full(b - a + 1, high) for a, b, _, high in part])
        np.testing.assert_array_equal(low, space.low)
        np.testing.assert_array_equal(high, space.high)
    for word in ("Reward:", "End:", "Start:", "What the law changes:"):
        assert word in (type(env).__doc__ or "")


def test_package_exports_the_environments():
    for name in IDS:
        entry = gymnasium.spec(name).entry_point
        assert isinstance(entry, str)
        assert getattr(impactlaw.envs, entry.partition(":")[2]) is type(bare(name))


# Gymnasium's API


@every_env
@pytest.mark.parametrize(
    "law",
    [
        None, Moreau(0.5), MaximalDissipation(), Poisson(0.5), Poisson(lambda speed: 0.5), Compliant(0.5),
        Reversal(1.0), Fremond([[0.5]]), Scattered(Newton(0.5), 0.1), AnyOutcome(),
    ],
    ids=lambda law: type(law).__name__,
)  # fmt: skip
def test_check_env(name, law):
    check_env(bare(name, law=law), skip_render_check=True)  # any warning is an error here


@every_env
def test_same_seed_same_episode_bit_for_bit(name):
    first, second = (rollout(gymnasium.make(name), 60, seed=5) for _ in range(2))
    assert same(first, second)
    assert not np.array_equal(first[0][0], rollout(gymnasium.make(name), 0, seed=6)[0][0])
    used = gymnasium.make(name)
    rollout(used, 35, seed=9, actions_seed=1)
    assert same(first, rollout(used, 60, seed=5))


@every_env
def test_a_step_takes_as_long_as_it_says(name):
    env = bare(name)
    env.reset(seed=0)
    start = env.data.time
    env.step(np.zeros(env.action_space.shape))
    assert env.data.time - start == pytest.approx(env.dt, rel=1e-12)


@every_env
def test_random_actions(name):
    env = gymnasium.make(name)
    for observation, reward, info in rollout(env, 350):
        assert observation in env.observation_space
        assert np.isfinite(reward)
        assert {key: type(value) for key, value in info.items()} == INFO
        assert info["impact/energy_change"] - info["impact/surface_work"] <= 1e-9
        assert info["impact/diverged"] == 0


@every_env
@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_laws_and_contact_models(name, contact_model):
    for law, restitution in (("maximal-dissipation", None), ("moreau", 1.0), ("reversal", 1.0), ("scene", None)):
        env = gymnasium.make(name, law=law, restitution=restitution, contact_model=contact_model)
        assert all(observation in env.observation_space for observation, _, _ in rollout(env, 40))


@every_env
def test_frame_skip(name):
    coarse, fine = bare(name, frame_skip=6), bare(name, frame_skip=3)
    action = np.full(coarse.action_space.shape, 0.5)
    for env in (coarse, fine):
        env.reset(seed=1)
    for _ in range(3):
        whole, *_ = coarse.step(action)
        fine.step(action)
        half, *_ = fine.step(action)
        np.testing.assert_array_equal(whole, half)
    assert coarse.data.time == pytest.approx(3 * coarse.dt)
    assert coarse.metadata["render_fps"] == round(1 / coarse.dt)


@every_env
def test_vectorised(name):
    results = []
    for mode in ("sync", "async"):
        envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode=mode)
        envs.action_space.seed(3)
        observation, info = envs.reset(seed=3)
        seen = [observation]
        for _ in range(20):
            observation, reward, _, _, info = envs.step(envs.action_space.sample())
            seen += [observation, reward]
        assert set(INFO) <= set(info)
        assert all(info[key].shape == (2,) for key in INFO)
        envs.close()
        results.append(seen)
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))


@every_env
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_goes_on_from_the_same_state(name, copied):
    env = gymnasium.make(name)
    rollout(env, 25)
    twin = copied(env)
    rng = np.random.default_rng(1)
    for _ in range(25):
        action = rng.uniform(env.action_space.low, env.action_space.high)
        (mine, *rest), (its, *others) = env.step(action), twin.step(action)
        np.testing.assert_array_equal(mine, its)
        assert rest == others
        if rest[1] or rest[2]:
            np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])
    assert env.unwrapped.data is not twin.unwrapped.data


# Law and errors


@every_env
def test_the_law_is_the_one_asked_for(name):
    assert bare(name, law="moreau", restitution=0.25).law == Moreau(0.25)
    assert bare(name, law=Reversal(0.5)).law == Reversal(0.5)
    own = bare(name, law="scene").law
    assert isinstance(own, Newton)
    assert bare(name, law="moreau").law == Moreau(own.default)
    assert bare(name, law="maximal-dissipation").law == MaximalDissipation()


@every_env
@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"law": "moro"}, UnknownNameError, "moreau"),
        ({"law": "moreau", "restitution": 1.5}, RestitutionError, r"\[0, 1\]"),
        ({"law": "maximal-dissipation", "restitution": 0.5}, RestitutionError, "leave it out"),
        ({"law": "fremond"}, RestitutionError, "matrix"),
        ({"law": "scene", "restitution": 0.5}, RestitutionError, "from the scene"),
        ({"law": Moreau(0.5), "restitution": 0.5}, RestitutionError, "already has"),
        ({"law": Newton({("nobody", "floor"): 0.5}, default=0.1)}, UnknownNameError, "nobody"),
        ({"contact_model": "hard"}, UnknownNameError, "rigid"),
        ({"frame_skip": 0}, SceneError, "frame_skip"),
        ({"frame_skip": 1.5}, SceneError, "frame_skip"),
    ],
    ids=lambda value: "",
)
def test_what_does_not_fit_is_one_clear_error(name, kwargs, error, message):
    with pytest.raises(error, match=message) as raised:
        gymnasium.make(name, **kwargs)
    assert isinstance(raised.value, ImpactLawError)
    assert "\n" not in str(raised.value)


@every_env
def test_unknown_render_mode(name):
    with pytest.raises(UnknownNameError, match="rgb_array"):
        type(bare(name))(render_mode="rgb")


@every_env
def test_actions_that_are_none(name):
    env = bare(name)
    env.reset(seed=0)
    size = env.action_space.shape[0]
    for action in (np.full(size, np.nan), np.zeros(size + 1), np.zeros((size, 1))):
        with pytest.raises(ActionError, match="finite"):
            env.step(action)


@every_env
def test_actions_beyond_their_space_are_clipped(name):
    ends = []
    for size in (1.0, 100.0):
        env = bare(name)
        env.reset(seed=0)
        ends.append([env.step(np.full(env.action_space.shape, size))[0] for _ in range(5)])
    np.testing.assert_array_equal(*ends)


@every_env
def test_divergence_ends_the_episode_where_the_step_began(name):
    env = bare(name)
    env.reset(seed=0)
    before, *_ = env.step(np.zeros(env.action_space.shape))
    env.model.opt.gravity[:] = np.nan
    observation, reward, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
    np.testing.assert_array_equal(observation, before)
    assert (reward, terminated, truncated, info["impact/diverged"]) == (0.0, False, True, 1)
    env.model.opt.gravity[:] = 0
    observation, info = env.reset(seed=0)
    assert info["impact/diverged"] == 0
