"""Training, where stable-baselines3 is installed, and the message where it is not."""

import importlib.util
import json

import gymnasium
import numpy as np
import pandas as pd
import pytest

from impactlaw.errors import MissingExtraError, StudyError, UnsupportedError
from impactlaw.laws import Moreau
from impactlaw.studies import Study, run
from impactlaw.studies.environments import Conditions
from impactlaw.studies.laws import read_law

INSTALLED = importlib.util.find_spec("stable_baselines3") is not None
needs_training = pytest.mark.skipif(not INSTALLED, reason="stable-baselines3 is not installed")
SHORT = Study(
    tasks=("impactlaw/Billiards-v0",), train=("moreau:0.4..1",), act=("moreau:0.5", "moreau:0.9"), seeds=(0,),
    episodes=1, steps=1,
)  # fmt: skip


@pytest.mark.parametrize("policy", ["ppo", "mine.zip"])
def test_a_missing_package_is_named_with_the_extra_that_brings_it(policy, tmp_path, monkeypatch):
    find = importlib.util.find_spec

    def hidden(name: str, *rest):
        return None if name.startswith("stable_baselines3") else find(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", hidden)
    study = Study(tasks=("impactlaw/Billiards-v0",), act=("moreau:0.5",), policies=(policy,))
    with pytest.raises(MissingExtraError, match=r"stable-baselines3.*impactlaw\[train\]"):
        run(study, tmp_path)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Train once for all tests, with rollouts of 8 steps, because a full rollout per test would take too long."""
    if not INSTALLED:
        pytest.skip("stable-baselines3 is not installed")
    import stable_baselines3

    class Short(stable_baselines3.PPO):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options | {"n_steps": 8, "n_epochs": 2})

    folder = tmp_path_factory.mktemp("short")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stable_baselines3, "PPO", Short)
        yield folder, run(SHORT, folder, backend="sequential", jobs=1)


@needs_training
def test_a_policy_is_trained_once_and_kept_with_its_settings(short):
    folder, table = short
    (trained,) = set(table["trained"])
    assert len(table) == 2
    assert sorted(path.name for path in (folder / "policies").iterdir()) == [f"{trained}.json", f"{trained}.zip"]
    settings = json.loads((folder / "policies" / f"{trained}.json").read_text())
    assert settings["training"] == {
        "task": "impactlaw/Billiards-v0",
        "scheme": "event-driven",
        "law": {"laws": ["moreau"], "restitution": [0.4, 1.0]},
    }
    assert (settings["steps"], settings["seed"]) == (1, 0)


@needs_training
def test_a_kept_policy_is_used_again_and_acts_the_same(short):
    folder, table = short
    zips = {path: path.stat().st_mtime_ns for path in (folder / "policies").iterdir()}
    for path in (folder / "cells").iterdir():
        path.unlink()
    pd.testing.assert_frame_equal(run(SHORT, folder, backend="sequential", jobs=1), table, check_exact=True)
    assert {path: path.stat().st_mtime_ns for path in zips} == zips


@needs_training
def test_a_trained_file_is_a_policy(short, monkeypatch):
    folder, table = short
    monkeypatch.chdir(folder)
    (zipped,) = (folder / "policies").glob("*.zip")
    name = f"policies/{zipped.name}"
    study = Study(tasks=SHORT.tasks, act=SHORT.act, policies=(name,), seeds=(0,), episodes=1)
    again = run(study, folder, backend="sequential", jobs=1)
    assert again["score"].tolist() == table["score"].tolist()
    assert set(again["policy"]) == {name}


@needs_training
def test_the_same_seed_trains_the_same_policy(short, tmp_path):
    _, table = short
    pd.testing.assert_frame_equal(run(SHORT, tmp_path, backend="sequential", jobs=1), table, check_exact=True)


@needs_training
@pytest.mark.parametrize("content", [b"no zip", None])
def test_a_file_that_is_no_policy_is_refused(content, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / "mine.zip").write_bytes(content)
    study = Study(tasks=SHORT.tasks, act=SHORT.act, policies=("mine.zip",))
    with pytest.raises(StudyError, match="cannot read" if content is None else "no trained policy"):
        run(study, tmp_path)


@needs_training
@pytest.mark.parametrize("scheme", ["time-stepping", "soft"])
def test_worlds_are_as_single_environments(scheme):
    from impactlaw.studies.policies.worlds import training_worlds

    conditions = Conditions("Hopper-v5", read_law("moreau:0.3"), scheme)
    worlds = training_worlds(conditions, 3)
    assert worlds is not None
    singles = [conditions.make() for _ in range(3)]
    worlds.seed(7)
    observed, rng, ends = worlds.reset(), np.random.default_rng(0), 0
    for i, env in enumerate(singles):
        np.testing.assert_allclose(observed[i], env.reset(seed=7 + i)[0], atol=1e-12)
    for _ in range(60):
        action = rng.uniform(-1.0, 1.0, (3, 3)).astype(np.float32)
        observed, reward, over, infos = worlds.step(action)
        for i, env in enumerate(singles):
            mine, gain, terminated, truncated, _ = env.step(action[i])
            assert over[i] == (terminated or truncated)
            assert reward[i] == pytest.approx(gain, abs=1e-5)
            if over[i]:
                np.testing.assert_allclose(infos[i]["terminal_observation"], mine, atol=1e-6)
                assert infos[i]["TimeLimit.truncated"] == (not terminated)
                mine, ends = env.reset()[0], ends + 1
            np.testing.assert_allclose(observed[i], mine, atol=1e-6)
    assert ends > 0
    worlds.close()


@needs_training
def test_worlds_draw_a_law_for_each_episode():
    from impactlaw.studies.policies.worlds import Worlds, training_worlds

    worlds = training_worlds(Conditions("Hopper-v5", read_law("moreau:0.4..1"), "time-stepping"), 4)
    assert isinstance(worlds, Worlds)
    worlds.seed(0)
    worlds.reset()
    first = worlds.get_attr("batch")[0].restitution.copy()
    assert len(set(first)) == 4
    assert (first >= 0.4).all()
    assert (first <= 1.0).all()
    over = np.zeros(4, bool)
    while not over.any():
        _, _, over, _ = worlds.step(np.ones((4, 3), np.float32))
    assert ((worlds.get_attr("batch")[0].restitution != first) == over).all()


@needs_training
def test_attributes_of_worlds_are_their_own():
    """Regression: each world had the laws of all worlds, and None for missing attributes."""
    from impactlaw.studies.policies.worlds import Worlds

    worlds = Worlds(gymnasium.make_vec("impactlaw/Hopper-v5", 3, law=[Moreau(0.1), Moreau(0.2), Moreau(0.3)]))
    assert worlds.get_attr("law", [2, 0]) == [Moreau(0.3), Moreau(0.1)]
    assert worlds.get_attr("restitution") == [0.1, 0.2, 0.3]
    with pytest.raises(AttributeError, match="laws"):
        worlds.get_attr("laws")
    worlds.close()


@needs_training
def test_what_worlds_do_not_have_is_refused():
    from impactlaw.studies.policies.worlds import training_worlds

    worlds = training_worlds(Conditions("Hopper-v5", read_law("moreau:0.3"), "time-stepping"), 2)
    assert worlds is not None
    with pytest.raises(UnsupportedError, match=r"restitution of the worlds of a training cannot be set: .* study"):
        worlds.set_attr("restitution", 0.5)
    with pytest.raises(UnsupportedError, match=r"reset_model cannot be called on one world: .* gymnasium\.make$"):
        worlds.env_method("reset_model", indices=0)
    assert list(worlds.get_attr("batch")[0].restitution) == [0.3, 0.3]
    worlds.close()


@needs_training
def test_tasks_and_laws_without_worlds_have_none():
    from impactlaw.studies.policies.worlds import training_worlds

    for task, law, scheme in (
        ("impactlaw/Billiards-v0", "moreau:0.5", "time-stepping"),
        ("impactlaw/Juggler-v0", "moreau:0.5", "soft"),
        ("Hopper-v5", "moreau:0.5", "event-driven"),
        ("Ant-v5", "poisson:0.5", "soft"),
        ("Hopper-v5", "mujoco", "time-stepping"),
        ("Ant-v5", "routh:0.5", "time-stepping"),
    ):
        assert training_worlds(Conditions(task, read_law(law), scheme), 2) is None
    assert "impactlaw/Hopper-v5" in gymnasium.registry
