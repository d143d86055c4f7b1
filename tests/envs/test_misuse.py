"""Environments with wrong arguments, and pictures of several environments."""

import ctypes.util
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from own_envs import bare, every_env
from wrapped import V5, hopper, make_any, theirs

from impactlaw.envs import ImpactLaw, RandomLaw
from impactlaw.errors import ActionError, OptionError, UnknownNameError

pytestmark = theirs


# Actions that are not finite


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("contact_model", ["soft", "rigid"])
@pytest.mark.parametrize(
    ("name", "bad"),
    [
        *((name, bad) for name in ("Hopper-v5", "Ant-v5") for bad in (np.nan, np.inf, 1e11)),
        *((("hopper", "hop"), bad) for bad in (np.nan, np.inf)),  # dm_control clips large values
    ],
    ids=str,
)
def test_an_action_that_is_not_finite_ends_the_episode(name, contact_model, bad):
    env = ImpactLaw(make_any(name), "moreau", 0.5, contact_model=contact_model)
    observation, _ = env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(np.zeros(env.action_space.shape))
    action = np.zeros(env.action_space.shape)
    action[0] = bad
    last, reward, terminated, truncated, info = env.step(action)
    assert (reward, terminated, truncated, info["impact/diverged"]) == (0.0, False, True, 1)
    np.testing.assert_equal(last, observation)
    env.reset(seed=0)
    *_, truncated, info = env.step(np.zeros(env.action_space.shape))
    assert not truncated
    assert info["impact/diverged"] == 0


class Spoiling(gymnasium.ActionWrapper):
    """A wrapper from elsewhere that divides by zero."""

    def action(self, action):
        return np.full_like(action, np.nan)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", V5)
def test_nan_that_a_wrapper_inside_makes_ends_the_episode_too(name):
    env = ImpactLaw(Spoiling(gymnasium.make(name)), "moreau", 0.5)
    observation, _ = env.reset(seed=0)
    last, reward, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert (reward, terminated, truncated, info["impact/diverged"]) == (0.0, False, True, 1)
    np.testing.assert_array_equal(last, observation)


# Own environments


def test_a_step_before_the_first_reset():
    with pytest.raises(ResetNeeded, match=r"begins with reset\(\)"):
        bare("impactlaw.envs:impactlaw/Juggler-v0").step(np.zeros(1))


def test_actions_that_are_no_numbers():
    env = bare("impactlaw.envs:impactlaw/Juggler-v0")
    env.reset(seed=0)
    for action in ("up", None, {"up": 1}, [[1.0], [2.0, 3.0]]):
        with pytest.raises(ActionError, match=r"1 finite number"):
            env.step(action)


class WithOptions(gymnasium.Wrapper):
    """A wrapper from elsewhere whose reset has options of its own."""

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=seed)


def test_options_that_are_no_mapping():
    inside = ImpactLaw(WithOptions(gymnasium.make("Hopper-v5")), "moreau", 0.5)
    inside.reset(options={"own": 1, "restitution": 0.2})
    for env in (bare("impactlaw.envs:impactlaw/Juggler-v0"), hopper(), inside):
        with pytest.raises(OptionError, match="options of a reset are a mapping"):
            env.reset(options=["law"])


@every_env
def test_a_first_reset_that_fails_leaves_the_environment_usable(name):
    for env in (gymnasium.make(name), ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5)):
        with pytest.raises(UnknownNameError, match="restitutoin"):
            env.reset(options={"restitutoin": 0.3})
        env.reset(seed=0)
        for _ in range(2):
            env.step(np.zeros(env.action_space.shape))


@every_env
def test_the_checker_of_gymnasium_finds_nothing(name):
    env = gymnasium.make(name, disable_env_checker=False)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(env.action_space.shape))


# Pictures


TWO = """
import gymnasium, numpy as np, sys
from impactlaw.envs import ImpactLaw
from impactlaw.errors import ActionError, OptionError
def make(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    env = env if name.startswith("impactlaw") else ImpactLaw(env, "moreau", 0.5)
    env.reset(seed=0)
    return env
first, second = map(make, sys.argv[1:])
wanted = first.render(), second.render()
assert all(picture.mean() > 10 for picture in wanted)
assert np.array_equal(first.render(), wanted[0]) and np.array_equal(second.render(), wanted[1])
first.close()
assert np.array_equal(second.render(), wanted[1]), "after closing the first"
third = make(sys.argv[1])
assert np.array_equal(third.render(), wanted[0])
assert np.array_equal(second.render(), wanted[1]), "beside a third"
third.close()
del first, third
assert np.array_equal(second.render(), wanted[1]), "after closing the third"
second.close()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are for machines without a display")
@pytest.mark.parametrize("backend", ["egl", "osmesa"])
@pytest.mark.parametrize(
    "names",
    [
        ("impactlaw.envs:impactlaw/Juggler-v0", "impactlaw.envs:impactlaw/Billiards-v0"),
        ("impactlaw.envs:impactlaw/Billiards-v0", "Hopper-v5"),
        ("Hopper-v5", "HalfCheetah-v5"),
    ],
    ids=str,
)
def test_closing_one_of_two_that_draw_leaves_the_other_its_pictures(names, backend):
    if not ctypes.util.find_library({"egl": "EGL", "osmesa": "OSMesa"}[backend]):
        pytest.skip(f"there is no library for {backend}")
    environment = os.environ | {"MUJOCO_GL": backend}
    environment.pop("PYOPENGL_PLATFORM", None)
    command = [sys.executable, "-W", "ignore", "-c", TWO, *names]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("wrap", [ImpactLaw, lambda env, *law: RandomLaw(ImpactLaw(env, *law))])
@pytest.mark.parametrize("seed", [-1, 1.5, "one", [1, 2]])
def test_an_invalid_seed_is_refused_and_changes_nothing(wrap, seed):
    env, twin = (wrap(gymnasium.make("Hopper-v5"), "any-outcome") for _ in range(2))
    for one in (env, twin):
        one.reset(seed=0)
    with pytest.raises(OptionError, match=r"a seed is a whole number, 0 or more, got"):
        env.reset(seed=seed)
    (observation, info), (expected, same) = env.reset(), twin.reset()
    np.testing.assert_array_equal(observation, expected)
    assert info == same
