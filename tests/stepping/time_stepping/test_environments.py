"""Time stepping in environments from elsewhere and our own, and on the command line."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from dm_control import suite
from own_envs import IDS
from wrapped import theirs

from impactlaw import Moreau, Stepper
from impactlaw.envs import ImpactLaw, put_law
from impactlaw.errors import ImpactLawError, UnknownNameError
from impactlaw.models import SCENES, load

pytestmark = theirs


def rollout(env, steps, seed=0):
    env.action_space.seed(seed)
    observation, _ = env.reset(seed=seed)
    seen = [observation]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(reward)
        assert info["impact/diverged"] == 0
        seen.append(observation)
        if terminated or truncated:
            seen.append(env.reset()[0])
    return np.array(seen)


@pytest.mark.parametrize("name", ["Hopper-v5", "Walker2d-v5", "Ant-v5", "HalfCheetah-v5", "Humanoid-v5", "Swimmer-v5",
                                  "InvertedDoublePendulum-v5", "Reacher-v5", "Pusher-v5"])  # fmt: skip
def test_environments_of_gymnasium_run_without_an_exception_and_repeat(name):
    runs = []
    for _ in range(2):
        env = ImpactLaw(gymnasium.make(name), "moreau", 0.5, contact_model="rigid")
        runs.append(rollout(env, 60))
        env.close()
    assert np.isfinite(runs[0]).all()
    np.testing.assert_array_equal(*runs)


def test_time_stepping_is_what_environments_of_others_get():
    """Event-driven stepping is used on request; its trajectories differ, but both have rigid contact."""
    runs = {}
    for scheme in (None, "time-stepping", "event-driven"):
        env = ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, contact_model="rigid", scheme=scheme)
        runs[scheme] = rollout(env, 20)
        env.close()
    np.testing.assert_array_equal(runs[None], runs["time-stepping"])
    assert not np.array_equal(runs[None], runs["event-driven"])
    assert runs[None][:8] == pytest.approx(runs["event-driven"][:8], abs=0.2)


def test_collisions_are_counted_in_info():
    env = ImpactLaw(gymnasium.make("Hopper-v5"), "newton", 0.5, contact_model="rigid")
    env.action_space.seed(0)
    env.reset(seed=0)
    count = 0
    for _ in range(60):
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        assert info["impact/count"] == len(env.events)
        assert info["impact/energy_change"] <= 1e-9
        count += info["impact/count"]
        if terminated or truncated:
            env.reset()
    assert count > 0


def test_a_wrong_scheme_is_refused():
    with pytest.raises(UnknownNameError, match="time-stepping"):
        ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, contact_model="rigid", scheme="nonsense").reset(seed=0)
    with pytest.raises(ImpactLawError, match="scheme"):
        ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, scheme="time-stepping").reset(seed=0)


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"]
)
def test_wrapped_environments_survive_copies(duplicate):
    env = ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, contact_model="rigid")
    rollout(env, 10)
    other = duplicate(env)
    np.testing.assert_array_equal(rollout(env, 15, seed=3), rollout(other, 15, seed=3))


@pytest.mark.parametrize("task", [("hopper", "hop"), ("cheetah", "run"), ("walker", "walk"), ("ball_in_cup", "catch"),
                                  ("quadruped", "walk"), ("finger", "spin")], ids="-".join)  # fmt: skip
def test_tasks_of_dm_control_run(task):
    env = suite.load(*task, task_kwargs={"random": 1})
    put_law(env, Moreau(0.5), contact_model="rigid")
    spec, rng = env.action_spec(), np.random.default_rng(0)
    env.reset()
    for _ in range(30):
        timestep = env.step(rng.uniform(spec.minimum, spec.maximum))
        assert np.isfinite(env.physics.data.qpos).all()
    assert timestep.reward is not None


@pytest.mark.parametrize("name", IDS)
def test_our_own_environments_take_the_scheme(name):
    env = gymnasium.make(name, scheme="time-stepping")
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(40):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert info["impact/diverged"] == 0
        if terminated or truncated:
            env.reset()
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_our_own_environments_have_located_collisions_unless_told(name):
    runs = []
    for options in ({}, {"scheme": "event-driven"}):
        env = gymnasium.make(name, **options)
        env.action_space.seed(0)
        runs.append([env.reset(seed=0)[0], *(env.step(env.action_space.sample())[0] for _ in range(5))])
        env.close()
    np.testing.assert_array_equal(*runs)


# --- the command line ------------------------------------------------------------------------------------------------


def test_compare_takes_the_scheme(command, tmp_path):
    code, out, err = command("compare", "ball_chain", "--scheme", "time-stepping", "--duration", "0.05")
    assert code == 0, err
    assert "(0, 0, 1)" in out
    assert "(-0.3333, 0.6667, 0.6667)" in out
    assert (tmp_path / "out" / "ball_chain" / "reversal.rrd").exists()


def test_compare_of_the_cradle_has_the_reversal(command):
    code, out, err = command("compare", "newtons_cradle", "--scheme", "time-stepping", "--duration", "0.05")
    assert code == 0, err
    assert "(0, 0, 0, 0, 1)" in out


@pytest.mark.parametrize("scene", SCENES)
def test_plan_takes_the_scheme(command, scene):
    code, out, err = command("plan", scene, "--scheme", "time-stepping")
    assert code == 0, err
    assert out != command("plan", scene)[1]


def test_plan_says_what_time_stepping_does(command):
    code, out, _ = command("plan", "newtons_cradle", "--scheme", "time-stepping")
    assert code == 0
    assert "runs" in out


def test_the_command_line_names_the_schemes(command):
    code, _, err = command("compare", "ball_chain", "--scheme", "nonsense")
    assert code == 2
    assert "time-stepping" in err


def test_the_stepper_has_the_plan_of_its_scheme():
    model, _ = load("box_drop")
    one, other = Stepper(model, Moreau(0.5)), Stepper(model, Moreau(0.5), scheme="time-stepping")
    assert str(one.plan) != str(other.plan)
    assert (one.plan.scheme, other.plan.scheme) == ("event-driven", "time-stepping")
