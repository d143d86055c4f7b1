"""Recordings of environments: one new file each, never overwritten, and the episodes in them."""

import copy

import gymnasium
import numpy as np
import pytest
from dm_control import suite
from recorded_envs import JUGGLER, every_maker, makers, play
from wrapped import drop, hopper, theirs

from impactlaw.envs import put_law
from impactlaw.errors import OptionError, RecordingError
from impactlaw.recording import read_log

pytestmark = theirs


def files(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments_write_a_file_each(mode, tmp_path):
    vector = gymnasium.make_vec(JUGGLER, num_envs=3, vectorization_mode=mode, log=str(tmp_path / "run-{env}.rrd"))
    vector.reset(seed=[1, 2, 3])
    for _ in range(5):
        vector.step(vector.action_space.sample())
    vector.close()
    assert files(tmp_path) == ["run-0.rrd", "run-1.rrd", "run-2.rrd"]
    logs = [read_log(tmp_path / name) for name in files(tmp_path)]
    assert sorted(log.properties["seed"] for log in logs) == [1, 2, 3]
    assert [len(log.episode(0).actions) for log in logs] == [5, 5, 5]


def test_vector_environments_that_would_share_a_file_are_refused(tmp_path):
    vector = gymnasium.make_vec(JUGGLER, num_envs=2, vectorization_mode="sync", log=str(tmp_path / "run.rrd"))
    for _ in range(2):  # the second environment reports it every time, and starts no other file
        with pytest.raises(RecordingError, match=r'run\.rrd is there already, .*log=".*run-\{env\}\.rrd"'):
            vector.reset(seed=0)
    vector.close()
    assert files(tmp_path) == ["run.rrd"]


@pytest.mark.parametrize("when", ["before", "during", "after"])
@every_maker
def test_an_environment_made_from_the_spec_does_not_write_over_the_recording(name, when, tmp_path):
    path = tmp_path / "run.rrd"
    env = gymnasium.make(JUGGLER, log=path) if name.startswith("own") else hopper(log=path)
    spec = env.spec
    if when == "before":
        again = gymnasium.make(spec)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    if when == "after":
        env.close()
    size = path.stat().st_size
    with pytest.raises(RecordingError, match="is there already"):
        if when == "before":
            again.reset(seed=0)
        else:
            gymnasium.make(spec)
    assert path.stat().st_size == size
    env.close()
    assert len(read_log(path).episodes) == 1


def test_numbered_environments_made_from_one_spec(tmp_path):
    env = hopper(log=tmp_path / "run-{env}.rrd")
    for one in (env, gymnasium.make(env.spec), gymnasium.make(env.spec)):
        one.reset(seed=0)
        one.step(one.action_space.sample())
        one.close()
    assert files(tmp_path) == ["run-0.rrd", "run-1.rrd", "run-2.rrd"]


def test_an_environment_that_is_never_reset_makes_no_file(tmp_path):
    for env in (gymnasium.make(JUGGLER, log=tmp_path / "run-{env}.rrd"), hopper(log=tmp_path / "run-{env}.rrd")):
        env.close()
    assert files(tmp_path) == []


@every_maker
def test_a_file_per_episode(name, tmp_path):
    env = makers(log=tmp_path / "run-{env}-{episode:03d}.rrd")[name]()
    play(env, 3, 5)
    env.close()
    assert files(tmp_path) == [f"run-0-00{i}.rrd" for i in range(3)]
    for i, path in enumerate(files(tmp_path)):
        (episode,) = read_log(tmp_path / path).episodes
        assert episode.number == i


@every_maker
@pytest.mark.parametrize("path", ["run.rrd", "run-{episode}.rrd"])
def test_every_third_episode(name, path, tmp_path):
    env = makers(log=tmp_path / path, log_every=3)[name]()
    seen = play(env, 8, 4)
    env.close()
    episodes = [e for file in files(tmp_path) for e in read_log(tmp_path / file).episodes]
    assert [e.number for e in episodes] == [0, 3, 6]
    assert len(files(tmp_path)) == (1 if path == "run.rrd" else 3)
    for episode in episodes:
        np.testing.assert_array_equal(episode.actions, seen[episode.number][1])
        np.testing.assert_array_equal(episode.qpos[0], seen[episode.number][0][0][: episode.qpos.shape[1]])


def test_every_second_episode_of_bare_dm_control(tmp_path):
    env = drop()
    placed = put_law(env, "moreau", 0.5, log=tmp_path / "run-{episode}.rrd", log_every=2)
    for _ in range(4):
        env.reset()
        for _ in range(10):
            env.step([])
    placed.close()
    assert files(tmp_path) == ["run-0.rrd", "run-2.rrd"]
    (episode,) = read_log(tmp_path / "run-2.rrd").episodes
    assert len(episode.time) == 1 + 10 * 10
    assert episode.time[0] == 0.0
    assert episode.actions.shape == (10, 0)


def test_actions_and_rewards_of_bare_dm_control(tmp_path):
    rng, told = np.random.default_rng(0), []
    env = suite.load("cartpole", "balance", task_kwargs={"random": 0, "time_limit": 0.1})
    placed = put_law(env, "moreau", 0.5, log=tmp_path / "run.rrd")
    twin = copy.deepcopy(env)  # the copy does not record
    for _ in range(2):
        env.reset()
        step = None
        while step is None or not step.last():
            action = rng.uniform(-1.0, 1.0, 1)
            step = env.step(action)
            told.append((action, step.reward))
    env.step(action)  # this step only resets, without a reward
    twin.reset()
    twin.step(action)
    placed.remove()
    env.reset()
    env.step(action)
    first, second = read_log(tmp_path / "run.rrd").episodes[:2]
    actions, rewards = zip(*told, strict=True)
    np.testing.assert_array_equal(np.concatenate([first.actions, second.actions]), actions)
    np.testing.assert_array_equal(np.concatenate([first.rewards, second.rewards]), rewards)
    assert first.ended == second.ended == "truncated"


@pytest.mark.parametrize("path", ["run-{seed}.rrd", "run-{}.rrd", "run-{env.rrd", "run-{env:q}.rrd", "run-{0}.rrd"])
def test_fields_that_there_are_not(path, tmp_path):
    for make in makers(log=tmp_path / path).values():
        with pytest.raises(OptionError, match=r"fields \{env\} and \{episode\}"):
            make()
    assert files(tmp_path) == []


@pytest.mark.parametrize("every", [0, -1, 1.5, float("nan")])
def test_numbers_of_episodes_that_are_none(every, tmp_path):
    for make in makers(log=tmp_path / "run.rrd", log_every=every).values():
        with pytest.raises(OptionError, match="log_every"):
            make()


def test_log_every_means_nothing_without_log():
    for make in makers(log_every=3).values():
        with pytest.raises(OptionError, match="without log"):
            make()


@every_maker
def test_braces_that_are_written_twice_are_part_of_the_name(name, tmp_path):
    (tmp_path / "a{b}").mkdir()
    for given in ("c{{d}}.rrd", "a{{b}}/c{{d}}-{episode}.rrd"):
        env = makers(log=tmp_path / given)[name]()
        play(env, 1, 2)
        env.close()
    assert files(tmp_path) == ["a{b}", "c{d}.rrd"]
    assert files(tmp_path / "a{b}") == ["c{d}-0.rrd"]


@every_maker
def test_folders_of_episodes(name, tmp_path):
    for number in "01":
        (tmp_path / number).mkdir()
    env = makers(log=tmp_path / "{episode}" / "run.rrd")[name]()
    play(env, 2, 2)
    env.close()
    assert files(tmp_path / "1") == ["run.rrd"]


def test_a_folder_is_no_log(tmp_path):
    for make in makers(log=tmp_path).values():
        with pytest.raises(RecordingError, match=r"is a folder: log is the path of a file, such as .*run\.rrd"):
            make()


def test_the_name_that_an_error_offers_is_in_the_same_folder_and_can_be_taken(tmp_path):
    path = tmp_path / "a{{b}}.rrd"
    (tmp_path / "a{b}.rrd").write_text("")
    with pytest.raises(RecordingError) as refused:
        hopper(log=path)
    offered = str(refused.value).partition('log="')[2].rstrip('"')
    env = hopper(log=offered)
    play(env, 1, 2)
    env.close()
    assert files(tmp_path) == ["a{b}-0.rrd", "a{b}.rrd"]
