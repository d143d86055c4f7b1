"""Many worlds of environments with a driven mocap body behave as the single environment under time stepping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from impactlaw import Moreau
from impactlaw.envs import LawDistribution, RandomLaw
from impactlaw.envs.vector.worlds import VectorWorlds
from impactlaw.errors import ActionError, RestitutionError

NAMES = ["impactlaw/Juggler-v0", "impactlaw/RockingBlock-v0"]


def make(name: str, num_envs: int, **options: Any) -> VectorWorlds:
    env = gymnasium.make_vec(name, num_envs=num_envs, vectorization_mode="vector_entry_point", **options)
    assert isinstance(env, VectorWorlds)
    return env


def _as_singles(worlds: VectorWorlds, singles: Sequence[gymnasium.Env], steps: int, seed: int) -> tuple[int, int, int]:
    """Compare step by step; return the numbers of ended episodes, of truncated ones, and of collisions."""
    rng, over = np.random.default_rng(seed), np.zeros(len(singles), bool)
    ends = cuts = collisions = 0
    observed, info = worlds.reset(seed=seed)
    for i, single in enumerate(singles):
        mine, told = single.reset(seed=seed + i)
        np.testing.assert_allclose(observed[i], mine, atol=1e-12)
        assert info["impact/restitution"][i] == told["impact/restitution"]
        assert info["impact/law"][i] == told["impact/law"]
    for step in range(steps):
        action = rng.uniform(-1.2, 1.2, worlds.action_space.shape)
        action[0] = 1.0 if step % 60 < 30 else -1.0  # to the ends of the stroke
        observed, reward, terminated, truncated, info = worlds.step(action)
        for i, single in enumerate(singles):
            if over[i]:  # this step reset it
                mine, told = single.reset()
                np.testing.assert_allclose(observed[i], mine, atol=1e-12)
                assert (reward[i], terminated[i], truncated[i]) == (0.0, False, False)
            else:
                mine, gain, end, cut, told = single.step(action[i])
                np.testing.assert_allclose(observed[i], mine, atol=1e-7)
                assert reward[i] == pytest.approx(gain, abs=1e-7)
                assert (terminated[i], truncated[i]) == (end, cut)
                assert info["impact/count"][i] == told["impact/count"]
                collisions += told["impact/count"]
            assert info["impact/law"][i] == told["impact/law"]
            assert info["impact/restitution"][i] == told["impact/restitution"]
        over = terminated | truncated
        ends, cuts = ends + int(terminated.sum()), cuts + int(truncated.sum())
    return ends, cuts, collisions


@pytest.mark.parametrize("name", NAMES)
def test_observations_rewards_and_ends_are_those_of_one_world(name: str):
    worlds = make(name, 4, nthread=2, max_episode_steps=70)
    assert worlds.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    singles = [gymnasium.make(name, scheme="time-stepping", max_episode_steps=70) for _ in range(4)]
    ends, cuts, collisions = _as_singles(worlds, singles, 300, 3)
    assert cuts > 0
    assert ends > 0
    assert collisions > 10


@pytest.mark.parametrize("name", NAMES)
def test_laws_are_drawn_as_for_one_world(name: str):
    laws = LawDistribution(("moreau", "reversal", "maximal-dissipation"), (0.2, 0.9))
    worlds = make(name, 3, law=laws, max_episode_steps=60)
    singles = [
        RandomLaw(
            gymnasium.make(name, scheme="time-stepping", max_episode_steps=60), laws=laws.laws, restitution=(0.2, 0.9)
        )
        for _ in range(3)
    ]
    assert _as_singles(worlds, singles, 150, 11)[2] > 10


def test_each_world_can_have_a_law():
    worlds = make("impactlaw/Juggler-v0", 2, law=[Moreau(0.0), Moreau(0.9)])
    _, info = worlds.reset(seed=[3, 3])
    assert info["impact/restitution"].tolist() == [0.0, 0.9]
    for _ in range(60):
        worlds.step(np.zeros((2, 1)))
    observed, *_ = worlds.step(np.zeros((2, 1)))
    assert observed[0, 0] == pytest.approx(0.0, abs=1e-5)
    assert observed[1, 0] > 0.1


def test_what_cannot_be_is_refused():
    worlds = make("impactlaw/Juggler-v0", 2)
    worlds.reset(seed=0)
    with pytest.raises(ActionError, match="finite"):
        worlds.step(np.array([[0.0], [np.nan]]))
    with pytest.raises(RestitutionError, match="already has its restitution"):
        make("impactlaw/Juggler-v0", 2, law=[Moreau(0.1), Moreau(0.2)], restitution=0.5)


@pytest.mark.parametrize("name", NAMES)
def test_a_world_that_diverges_is_truncated_where_the_step_began(name: str):
    worlds = make(name, 3)
    worlds.reset(seed=0)
    before, *_ = worlds.step(np.full((3, 1), 0.5))
    worlds.batch.bind("qfrc_applied")[1] = np.nan
    after, reward, terminated, truncated, info = worlds.step(np.full((3, 1), 0.5))
    assert truncated.tolist() == [False, True, False]
    assert info["impact/diverged"].tolist() == [0, 1, 0]
    assert (reward[1], terminated[1]) == (0.0, False)
    assert np.array_equal(after[1], before[1])
    assert not np.array_equal(after[0], before[0])
    worlds.batch.bind("qfrc_applied")[1] = 0.0
    assert not worlds.step(np.full((3, 1), 0.5))[3].any()


@pytest.mark.parametrize("name", NAMES)
def test_results_do_not_depend_on_threads(name: str):
    ends = []
    for threads in (1, 3):
        worlds, rng = make(name, 7, nthread=threads), np.random.default_rng(0)
        worlds.reset(seed=0)
        for _ in range(40):
            worlds.step(rng.uniform(-1.0, 1.0, (7, 1)))
        ends.append(worlds.batch.state.copy())
    assert np.array_equal(*ends)
