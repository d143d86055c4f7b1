"""Many worlds of gymnasium's robots behave as gymnasium's own environments, except for contact."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw import Moreau, Stepper
from impactlaw.envs.vector.worlds import VectorWorlds

NAMES = ["Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5"]
WAYS = {"rigid": {"scheme": "time-stepping"}, "soft": {"contact_model": "soft", "on_inadmissible": "project"}}
IN_SPACE = ["Ant-v5", "Humanoid-v5"]


def make(name: str, num_envs: int, **options: Any) -> VectorWorlds:
    env = gymnasium.make_vec(f"impactlaw/{name}", num_envs=num_envs, vectorization_mode="vector_entry_point", **options)
    assert isinstance(env, VectorWorlds)
    return env


class Alone:
    """Gymnasium's own environment, stepped by a `Stepper`."""

    def __init__(self, name: str, restitution: float, contact_model: str):
        self.env: Any = gymnasium.make(name).unwrapped
        options: Any = WAYS[contact_model]
        self.stepper = Stepper(self.env.model, Moreau(restitution), **options)
        self.env._step_mujoco_simulation = self._step

    def _step(self, ctrl: np.ndarray, frames: int) -> None:
        self.env.data.ctrl[:] = ctrl
        self.count = 0
        for _ in range(frames):
            self.stepper.step(self.env.data)
            self.count += self.stepper.sums.collisions > 0
        mujoco.mj_rnePostConstraint(self.env.model, self.env.data)


@pytest.mark.parametrize("contact_model", WAYS)
@pytest.mark.parametrize("name", NAMES)
def test_observations_rewards_and_ends_are_gymnasiums(name: str, contact_model: str):
    worlds = make(name, 4, restitution=0.3, nthread=2, contact_model=contact_model)
    rng, singles = np.random.default_rng(0), [Alone(name, 0.3, contact_model) for _ in range(4)]
    observed, _ = worlds.reset(seed=7)
    for i, single in enumerate(singles):
        np.testing.assert_allclose(observed[i], single.env.reset(seed=7 + i)[0], atol=1e-12)
    over, ended, felt, endless = np.zeros(4, bool), 0, 0.0, name == "HalfCheetah-v5"
    for step in range(1000):  # until a world has ended and restarted: an Ant rarely falls
        if step >= 150 and (endless or (ended and not over.any())):
            break
        action = rng.uniform(-1.0, 1.0, worlds.action_space.shape).astype(np.float32)
        observed, reward, terminated, _, info = worlds.step(action)
        for i, single in enumerate(singles):
            if over[i]:  # this step reset it
                np.testing.assert_allclose(observed[i], single.env.reset()[0], atol=1e-12)
                assert reward[i] == 0.0
                continue
            mine, gain, end, _, told = single.env.step(action[i])
            np.testing.assert_allclose(observed[i], mine, atol=1e-6)
            assert reward[i] == pytest.approx(gain, abs=1e-6)
            assert terminated[i] == end
            for key, value in told.items():
                np.testing.assert_allclose(info[key][i], value, atol=1e-6, err_msg=key)
            assert info["impact/count"][i] == single.count
            felt = min(felt, told.get("reward_contact", 0.0))
        over, ended = terminated.copy(), ended + int(terminated.sum())
    assert ended > 0 or endless
    assert felt < -1e-3 or name not in IN_SPACE


@pytest.mark.parametrize("name", IN_SPACE)
def test_masses_of_a_world_of_its_own(name: str):
    """Humanoid's position is its centre of mass. Regression: worlds found it with the masses of the model."""
    worlds = make(name, 2, restitution=0.3, nthread=1)
    masses = worlds.batch.expand("body_mass")
    masses[1] *= np.linspace(0.3, 3.0, masses.shape[1])
    alone = Alone(name, 0.3, "rigid")
    alone.env.model.body_mass[:] = masses[1]
    worlds.reset(seed=[0, 3])
    alone.env.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(5):
        action = rng.uniform(-0.4, 0.4, worlds.action_space.shape).astype(np.float32)
        observed, reward, _, _, info = worlds.step(action)
        mine, gain, _, _, told = alone.env.step(action[1])
        np.testing.assert_allclose(observed[1], mine, atol=1e-9)
        assert reward[1] == pytest.approx(gain, abs=1e-9)
        assert info["x_velocity"][1] == pytest.approx(told["x_velocity"], abs=1e-9)


def test_episodes_are_truncated_and_begin_anew():
    worlds = make("HalfCheetah-v5", 2, max_episode_steps=5)
    assert worlds.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    worlds.reset(seed=0)
    action = np.zeros_like(worlds.action_space.sample())
    steps = [worlds.step(action)[3:] for _ in range(12)]
    assert [i for i, (cut, _) in enumerate(steps) if cut.all()] == [4, 10]
    for cut, info in steps:  # steps that only reset have the same entries
        assert info.keys() == steps[0][1].keys()
        assert cut.shape == info["impact/short"].shape
    assert not steps[5][1]["_impact/short"].any()


@pytest.mark.parametrize("contact_model", WAYS)
@pytest.mark.parametrize("name", ["Hopper-v5", "Ant-v5"])
def test_an_action_that_is_not_finite_ends_the_episode_of_its_world(name: str, contact_model: str):
    worlds = make(name, 2, contact_model=contact_model)
    for bad in (np.nan, np.inf, 1e11):
        before = worlds.reset(seed=0)[0]
        action = np.zeros_like(worlds.action_space.sample())
        action[0, -1] = bad
        observed, reward, terminated, truncated, info = worlds.step(action)
        np.testing.assert_array_equal(observed[0], before[0])
        assert (reward[0], terminated.tolist(), truncated.tolist()) == (0.0, [False] * 2, [True, False])
        assert info["impact/diverged"].tolist() == [1.0, 0.0]
        assert np.isfinite(reward).all()
        assert not worlds.step(0.0 * worlds.action_space.sample())[3].any()


@pytest.mark.parametrize("contact_model", WAYS)
def test_worlds_have_laws_of_their_own(contact_model: str):
    worlds = make("Hopper-v5", 2, law=[Moreau(0.0), Moreau(0.9)], contact_model=contact_model)
    assert worlds.get_attr("contact_model") == (contact_model, contact_model)
    assert worlds.get_attr("scheme") == (WAYS[contact_model].get("scheme"),) * 2
    observed, _ = worlds.reset(seed=[3, 3])
    action = np.zeros_like(worlds.action_space.sample())
    for _ in range(12):
        observed = worlds.step(action)[0]
    assert np.abs(observed[0] - observed[1]).max() > 1e-3
    assert worlds.batch.restitution.tolist() == [0.0, 0.9]
