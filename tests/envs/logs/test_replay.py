"""Replays of recorded episodes: what a recording stores about its environment, and what is refused."""

import gymnasium
import mujoco
import numpy as np
import pytest
from own_envs import bare
from recorded_envs import JUGGLER, every_maker, makers, play
from wrapped import hopper, shimmy, theirs

from impactlaw import AnyOutcome, Moreau, Newton
from impactlaw.envs import ImpactLaw, RandomLaw, restart
from impactlaw.envs.law_holder import law_holder
from impactlaw.errors import RecordingError
from impactlaw.recording import read_log
from impactlaw.recording.layout import EPISODE_COLUMNS

pytestmark = theirs


def assert_same_states(env, episode, laws=()):
    """Step through an episode, set laws on the way, and compare the states."""
    data, holder = env.unwrapped.data, law_holder(env)
    for i, (action, frame) in enumerate(zip(episode.actions, episode.frame, strict=True)):
        for change in laws:
            if change.step == i:
                holder.law = change.value
        env.step(action)
        np.testing.assert_array_equal(data.qpos, episode.qpos[frame])
        np.testing.assert_array_equal(data.qvel, episode.qvel[frame])


def test_actions_of_different_kinds_are_played_again(tmp_path):
    """The first action has integers; later ones keep their fractions."""
    env = makers(log=tmp_path / "run.rrd")["wrapped"]()
    env.reset(seed=5)
    told = [[0, 0, 0], np.full(3, 0.3, np.float32), np.full(3, 0.7), (0.1, 1, 0)]
    rewards = [env.step(action)[1] for action in told]
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    for action, wanted in zip(episode.actions, map(np.asarray, told), strict=True):
        np.testing.assert_array_equal(action, wanted)
        assert action.dtype == wanted.dtype
    again = makers()["wrapped"]()
    restart(again, episode)
    assert_same_states(again, episode)
    assert len(set(rewards)) > 2


class ManyRewards(gymnasium.Wrapper):
    """A wrapper from elsewhere that gives one reward for each of several objectives."""

    def step(self, action):
        observation, reward, *rest = self.env.step(action)
        return observation, np.array([reward, 0.0]), *rest


def test_a_reward_that_is_no_number_is_named(tmp_path):
    env = ImpactLaw(ManyRewards(gymnasium.make("Hopper-v5")), "moreau", 0.5, log=tmp_path / "run.rrd")
    env.reset(seed=0)
    with pytest.raises(RecordingError, match="one number as a reward, got array"):
        env.step(np.zeros(3))


def test_what_is_no_episode(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    env.reset(seed=5)
    env.close()
    with pytest.raises(RecordingError, match=r"one of read_log\(path\).episodes, got Recording"):
        restart(env, read_log(tmp_path / "run.rrd"))


# Laws that are set within an episode


@every_maker
def test_an_episode_in_which_the_law_was_set_is_not_taken_for_another(name, tmp_path):
    env = makers(log=tmp_path / "run.rrd")[name]()
    env.reset(seed=5)
    for step in range(60):
        if step == 20:
            env.law = Moreau(0.125)
        if step == 35:
            env.law = Newton(0.75)
        env.step(env.action_space.sample())
    env.reset(seed=6)
    env.step(env.action_space.sample())
    env.close()
    episode, after = read_log(tmp_path / "run.rrd").episodes
    assert after.law_changes == ()
    first = episode.law_changes[0]
    assert (first.step, first.frame, first.law) == (20, 20 * env.unwrapped.frame_skip + 1, repr(Moreau(0.125)))
    again = makers()[name]()
    with pytest.raises(RecordingError, match=r"set during episode 0: before step 20 to Moreau\(restitution=0.125\)"):
        restart(again, episode)
    restart(again, episode, allow_law_changes=True)
    assert_same_states(again, episode, episode.law_changes)


def test_a_law_that_cannot_be_written_down_is_named(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    env.reset(seed=5)
    env.step([0.0])
    env.law = Newton(lambda speed: 0.5)
    env.step([0.0])
    env.close()
    (change,) = read_log(tmp_path / "run.rrd").episode(0).law_changes
    assert (change.step, change.value) == (1, None)
    assert "lambda" in change.law


def test_the_same_law_that_is_set_again_is_no_change(tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    env.reset(seed=5)
    env.law = Newton(0.8)
    env.step([0.0])
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    assert episode.law_changes == ()
    restart(bare(JUGGLER), episode)


def test_a_law_at_the_start_that_cannot_be_written_down_is_compared_by_its_text(tmp_path):
    env = bare(JUGGLER, law=Newton(lambda speed: 0.5), log=tmp_path / "run.rrd")
    env.reset(seed=5)
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    assert episode.settings == {}
    restart(env, episode)
    with pytest.raises(RecordingError, match=r"lambda.*but this is one with Newton\(restitution=0.8"):
        restart(bare(JUGGLER), episode)


# Environments that were made with other arguments


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_skip": 2}, "frame_skip=5, but this is one with frame_skip=2"),
        ({"friction": "ignore"}, "friction='coulomb', but this is one with friction='ignore'"),
        ({"contact_model": "soft"}, "contact_model='rigid', but"),
        ({"frame_skip": 2, "friction": "convex"}, "frame_skip=5, friction='coulomb', but"),
    ],
    ids=str,
)
def test_another_own_environment_is_refused(options, message, tmp_path):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    play(env, 1, 3)
    env.close()
    with pytest.raises(RecordingError, match=message):
        restart(bare(JUGGLER, **options), read_log(tmp_path / "run.rrd").episode(0))


@pytest.mark.parametrize(
    ("recorded", "options", "message"),
    [
        ({}, {"limits": False}, "limits=True, but this is one with limits=False"),
        ({}, {"rest_speed": 0.5}, "rest_speed=None, but this is one with rest_speed=0.5"),
        ({}, {"contacts": "*foot*"}, "contacts=None, but"),
        ({}, {"on_inadmissible": "allow"}, "on_inadmissible='project', but"),
        ({}, {"impulse_in_cfrc_ext": True}, "impulse_in_cfrc_ext=False, but"),
        ({"contacts": ["*foot*"]}, {"contacts": ["*foot*/*floor*"]}, "contacts="),
    ],
    ids=str,
)
def test_another_wrapper_is_refused(recorded, options, message, tmp_path):
    env = hopper(log=tmp_path / "run.rrd", **recorded)
    play(env, 1, 3)
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    with pytest.raises(RecordingError, match=message):
        restart(hopper(**options), episode)
    restart(hopper(**recorded), episode)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_skip": 5}, "frame_skip=4, but"),
        ({"reset_noise_scale": 0.1}, r"a start with qpos\[0\] = .*, but this is one with .*, as by other noise"),
    ],
    ids=str,
)
def test_another_environment_of_gymnasium_is_refused(options, message, tmp_path):
    env = hopper(log=tmp_path / "run.rrd")
    play(env, 1, 3)
    env.close()
    other = ImpactLaw(gymnasium.make("Hopper-v5", **options), "moreau", 0.5)
    with pytest.raises(RecordingError, match=message):
        restart(other, read_log(tmp_path / "run.rrd").episode(0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda model: setattr(model.opt, "timestep", 0.001), "timestep=0.002, but this is one with timestep=0.001"),
        (lambda model: setattr(model.opt, "integrator", mujoco.mjtIntegrator.mjINT_EULER), "integrator='RK4', but"),
        (lambda model: model.body_mass.__imul__(2.0), "parameters of the model="),
        (lambda model: model.opt.gravity.__imul__(0.5), "parameters of the model="),
        (lambda model: model.opt.wind.__iadd__(1.0), "ground of the model="),
        (lambda model: setattr(model.opt, "viscosity", 0.1), "ground of the model="),
        (lambda model: model.geom_solimp.__imul__(0.9), "ground of the model="),
        (lambda model: model.jnt_solref.__imul__(2.0), "ground of the model="),
        (lambda model: model.body_ipos.__iadd__(0.01), "tendons of the model="),
        (lambda model: model.actuator_ctrlrange.__imul__(0.5), "tendons of the model="),
        (lambda model: model.qpos_spring.__iadd__(0.1), "tendons of the model="),
    ],
    ids=[
        "timestep",
        "integrator",
        "mass",
        "gravity",
        "wind",
        "viscosity",
        "solimp",
        "solref of joints",
        "centre of mass",
        "range of controls",
        "rest of springs",
    ],
)
def test_another_model_is_refused(change, message, tmp_path):
    env = hopper(log=tmp_path / "run.rrd")
    play(env, 1, 3)
    env.close()
    other = hopper()
    change(other.unwrapped.model)
    with pytest.raises(RecordingError, match=message):
        restart(other, read_log(tmp_path / "run.rrd").episode(0))


def test_masses_that_are_set_after_a_reset_are_recorded_with_the_first_step(tmp_path):
    env = hopper(log=tmp_path / "run.rrd")
    env.reset(seed=3)
    env.unwrapped.model.body_mass[1:] *= 1.2
    for _ in range(20):
        env.step(env.action_space.sample())
    env.reset(seed=4)
    for change in (1.0, 1.1):
        env.unwrapped.model.body_mass[1:] *= change
        for _ in range(5):
            env.step(env.action_space.sample())
    env.unwrapped.model.body_mass[1:] *= 0.5  # after the last step, for the next episode
    play(env, 1, 3)
    env.close()
    episodes = read_log(tmp_path / "run.rrd").episodes
    assert [episode.model_changes for episode in episodes] == [(), (5,), ()]
    with pytest.raises(RecordingError, match="parameters of the model="):
        restart(hopper(), episodes[0])
    again = hopper()
    again.unwrapped.model.body_mass[1:] *= 1.2
    restart(again, episodes[0])
    assert_same_states(again, episodes[0])
    with pytest.raises(RecordingError, match="the model was changed during episode 1, first before step 5"):
        restart(again, episodes[1])


def test_another_control_timestep_of_dm_control_is_refused(tmp_path):
    from dm_control import suite
    from dm_control.rl.control import Environment

    def make(substeps=4, **options):
        own = suite.load("hopper", "hop")
        task = Environment(own.physics, own.task, n_sub_steps=substeps)
        return ImpactLaw(shimmy().DmControlCompatibilityV0(task), "moreau", 0.5, **options)

    recorded = make(log=tmp_path / "run.rrd")
    recorded.reset(seed=3)
    recorded.step(np.zeros(4))
    recorded.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    restart(make(), episode)
    with pytest.raises(RecordingError, match="frame_skip=4, but this is one with frame_skip=2"):
        restart(make(2), episode)


@pytest.mark.parametrize(("mine", "theirs"), [("time-stepping", None), (None, "time-stepping")])
def test_the_scheme_is_the_recorded_one(mine, theirs, tmp_path):
    env = bare(JUGGLER, scheme=mine, log=tmp_path / "run.rrd")
    play(env, 1, 60)
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    again = bare(JUGGLER, scheme=theirs)
    restart(again, episode)
    assert_same_states(again, episode)


def test_a_random_law_around_makes_no_difference(tmp_path):
    env = RandomLaw(hopper(log=tmp_path / "run.rrd"), ("moreau", AnyOutcome(seed=3)))
    env.reset(seed=2)
    for _ in range(40):
        env.step(env.action_space.sample())
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    again = RandomLaw(hopper(), ("newton",))
    restart(again, episode)
    assert_same_states(again, episode)


def test_a_recording_of_before_tells_less_and_is_read(tmp_path, monkeypatch):
    env = bare(JUGGLER, log=tmp_path / "run.rrd")
    with monkeypatch.context() as patch:
        patch.delitem(EPISODE_COLUMNS, "made")
        play(env, 1, 3)
        env.close()
    episode = read_log(tmp_path / "run.rrd").episode(0)
    assert (episode.made, episode.law_changes, episode.seed) == ({}, (), 5)
    restart(bare(JUGGLER), episode)
