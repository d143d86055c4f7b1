"""Episodes in recordings: states, actions and rewards, and that they can be replayed."""

import itertools
import json

import gymnasium
import numpy as np
import pytest
from own_envs import bare, every_env
from recorded_envs import JUGGLER, every_maker, makers, play
from wrapped import hopper, shimmy_task, theirs

from impactlaw import Moreau, Newton, Stepper
from impactlaw.envs import ImpactLaw, restart
from impactlaw.errors import ImpactLawError, RecordingError, UnknownNameError, WrapperError
from impactlaw.recording import Recorder, describe, read_log

pytestmark = theirs


@every_maker
def test_a_recording_holds_states_actions_rewards_and_episodes(name, tmp_path):
    env = makers(log=tmp_path / "run.rrd")[name]()
    seen = play(env, 3)
    env.close()
    log = read_log(tmp_path / "run.rrd")
    assert [e.number for e in log.episodes] == [0, 1, 2]
    assert [e.seed for e in log.episodes] == [5, None, None]
    for episode, (states, actions, rewards) in zip(log.episodes, seen, strict=True):
        recorded = np.hstack([episode.qpos, episode.qvel])
        np.testing.assert_array_equal(recorded[np.append(0, episode.frame)], states)
        np.testing.assert_array_equal(episode.actions, actions)
        np.testing.assert_array_equal(episode.rewards, rewards)
        assert len(episode.time) == 1 + len(actions) * env.unwrapped.frame_skip
        assert episode.time[0] == 0.0
    assert len(log.series("qpos")[1]) == sum(len(e.time) for e in log.episodes)


@every_maker
@pytest.mark.parametrize("number", [0, 2])
def test_an_episode_can_be_played_again_from_a_recording(name, number, tmp_path):
    """Episodes with and without a seed, and under another law than the environment's."""
    env = makers(log=tmp_path / "run.rrd")[name]()
    play(env, 2)
    env.reset(options={"law": "moreau", "restitution": 0.125})
    for _ in range(30):
        env.step(env.action_space.sample())
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(number)
    again = makers()[name]()
    again.reset(seed=77)
    restart(again, episode)
    data = again.unwrapped.data
    assert len(episode.actions) > 20
    for action, reward, frame in zip(episode.actions, episode.rewards, episode.frame, strict=True):
        _, its, *_ = again.step(action)
        assert its == reward
        np.testing.assert_array_equal(data.qpos, episode.qpos[frame])
        np.testing.assert_array_equal(data.qvel, episode.qvel[frame])


@every_env
def test_every_environment_plays_its_second_episode_again(name, tmp_path):
    env = bare(name, log=tmp_path / "run.rrd")
    seen = play(env, 2, 25)
    env.close()
    again = bare(name)
    episode = read_log(tmp_path / "run.rrd").episode(1)
    restart(again, episode)
    for action, state in zip(episode.actions, seen[1][0][1:], strict=True):
        again.step(action)
        np.testing.assert_array_equal(np.append(again.data.qpos, again.data.qvel), state)


def test_the_law_of_collisions_and_episodes_is_the_one_in_force(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    env.reset(seed=0)
    for _ in range(100):
        env.step(np.zeros(1))
    env.law = Moreau(0.5)
    for _ in range(100):
        env.step(np.zeros(1))
    env.reset(options={"law": Newton(0.25)})
    for _ in range(100):
        env.step(np.zeros(1))
    env.close()
    log = read_log(tmp_path / "run.rrd")
    laws = [law for law, _ in itertools.groupby(log.collisions["law"])]
    assert laws == [repr(Newton(0.8)), repr(Moreau(0.5)), repr(Newton(0.25))]
    assert [e.law for e in log.episodes] == [repr(Newton(0.8)), repr(Newton(0.25))]


def test_how_episodes_end(tmp_path):
    env = bare(JUGGLER, law="moreau", restitution=1.0, log=tmp_path / "run.rrd")
    env.reset(seed=0)
    env.step(np.ones(1))
    env.data.qpos[0] = 2.5
    assert env.step(np.ones(1))[2]
    env.reset()
    env.step(np.ones(1))
    env.reset()
    env.step(np.ones(1))
    env.model.opt.gravity[:] = np.nan
    assert env.step(np.ones(1))[3]
    env.close()
    log = read_log(tmp_path / "run.rrd")
    assert [e.ended for e in log.episodes] == ["terminated", "", "truncated"]
    table = log.episode_summary()
    assert list(table["ended"]) == ["terminated", "", "truncated"]
    assert list(table["collisions"]) == [sum(log.collisions["episode"] == i) for i in range(3)]
    assert table["return"][0] == pytest.approx(sum(log.episode(0).rewards))


def test_inspect_shows_episodes(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    play(env, 2, 20)
    env.close()
    text = describe(read_log(tmp_path / "run.rrd"))
    block = text[text.index("episodes\n") :].split("\n\n")[0].splitlines()
    assert block[1].split() == [
        "episode",
        "seed",
        "law",
        "frames",
        "steps",
        "duration",
        "return",
        "ended",
        "collisions",
    ]
    assert len(block) == 4
    assert "5 Newton(restitution=0.8, default=None)" in block[2]


def test_a_recording_of_before_has_episodes_where_time_goes_back(tmp_path, scene, monkeypatch):
    from impactlaw.recording.episodes import EpisodeMarks

    monkeypatch.setattr(EpisodeMarks, "send", lambda self, stream: None)
    model, data = scene
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for time in (0.0, 0.1, 0.2, 0.0, 0.1):
            data.time = time
            recorder.step(data)
    episodes = read_log(tmp_path / "run.rrd").episodes
    assert [(e.number, len(e.time)) for e in episodes] == [(0, 3), (1, 2)]
    with pytest.raises(RecordingError, match="without a seed"):
        restart(bare(JUGGLER), episodes[0])


@pytest.fixture
def of_a_hopper(tmp_path):
    env = hopper(log=tmp_path / "run.rrd")
    play(env, 1, 2)
    env.close()
    return read_log(tmp_path / "run.rrd").episode(0)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: bare(JUGGLER), RecordingError, r"\(nq, nv\) = \(6, 6\), but this is one with"),
        (lambda: ImpactLaw(gymnasium.make("Walker2d-v5"), "moreau", 0.5), RecordingError, r"\(nq, nv\) = \(6, 6\)"),
        (lambda: ImpactLaw(gymnasium.make("Hopper-v4"), "moreau", 0.5), RecordingError, "Hopper-v5, but this is Hop"),
        (lambda: hopper(contact_model="rigid"), RecordingError, "contact_model='soft', but this is .*'rigid'"),
        (lambda: gymnasium.make("Hopper-v5"), WrapperError, "HopperEnv has no impact law; put one on it"),
    ],
    ids=["another", "another robot", "another version", "another contact model", "no law"],
)
def test_an_episode_is_played_again_where_it_was_recorded_only(of_a_hopper, make, error, message):
    with pytest.raises(error, match=message):
        restart(make(), of_a_hopper)


def test_an_episode_is_played_again_inside_other_wrappers(of_a_hopper):
    restart(gymnasium.wrappers.RecordEpisodeStatistics(hopper()), of_a_hopper)
    assert (of_a_hopper.scene, of_a_hopper.contact_model) == ("Hopper-v5", "soft")
    assert "contact_model" not in of_a_hopper.settings


def test_there_is_no_such_episode(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    play(env, 2, 2)
    env.close()
    with pytest.raises(UnknownNameError, match="unknown episode '7'; known: 0, 1"):
        read_log(tmp_path / "run.rrd").episode(7)


def test_dm_control_through_shimmy_records_actions_and_rewards(tmp_path):
    env = ImpactLaw(shimmy_task("hopper", "hop"), "moreau", 0.5, log=tmp_path / "run.rrd")
    env.reset(seed=3)
    rewards = [env.step(env.action_space.sample())[1] for _ in range(5)]
    env.close()
    (episode,) = read_log(tmp_path / "run.rrd").episodes
    assert list(episode.rewards) == rewards
    assert (episode.seed, episode.actions.shape) == (3, (5, 4))


def test_settings_are_plain_values(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    env.reset(seed=0, options={"law": Newton({("ball", "paddle"): 0.5}), "scheme": "time-stepping"})
    env.close()
    settings = read_log(tmp_path / "run.rrd").episode(0).settings
    assert json.loads(json.dumps(settings)) == settings
    assert settings["scheme"] == "time-stepping"


# States that do not follow from the actions


def push(env):
    env.unwrapped.data.qvel[0] += 0.25


@every_maker
def test_an_episode_in_which_the_state_was_changed_is_refused(name, tmp_path):
    env = makers(log=tmp_path / "run.rrd")[name]()
    for pushed in ((0,), (3, 7), ()):
        env.reset(seed=5)
        for step in range(10):
            if step in pushed:
                push(env)
            env.step(env.action_space.sample())
    push(env)  # for nothing: no step follows
    env.reset(seed=6)
    env.step(env.action_space.sample())
    env.close()
    episodes = read_log(tmp_path / "run.rrd").episodes
    assert [episode.state_changes for episode in episodes] == [(0,), (3, 7), (), ()]
    again = makers()[name]()
    with pytest.raises(RecordingError, match="the state was changed during episode 1, first before step 3, by hand or"):
        restart(again, episodes[1])
    restart(again, episodes[2])


@every_maker
def test_an_episode_that_goes_on_after_a_step_that_failed_halfway_is_refused(name, tmp_path, monkeypatch):
    env = makers(log=tmp_path / "run.rrd")[name]()
    env.reset(seed=5)
    env.step(env.action_space.sample())
    steps, known = itertools.count(), Stepper.step

    def failing(stepper, data, *more):
        if next(steps) == 1:
            raise ImpactLawError("the second timestep fails")
        return known(stepper, data, *more)

    with monkeypatch.context() as patch:
        patch.setattr(Stepper, "step", failing)
        with pytest.raises(ImpactLawError, match="the second timestep fails"):
            env.step(env.action_space.sample())
    env.step(env.action_space.sample())
    env.reset(seed=5)
    env.step(env.action_space.sample())
    env.close()
    broken, whole = read_log(tmp_path / "run.rrd").episodes
    assert (broken.state_changes, whole.state_changes) == ((1,), ())
    with pytest.raises(RecordingError, match="or by a step that failed halfway"):
        restart(makers()[name](), broken)
