"""Laws in bare dm_control environments, from suite and composer, and in their versions wrapped by shimmy."""

import copy
import pickle

import dm_env
import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import suite
from dm_control.rl.control import PhysicsError
from wrapped import NOTHING_HAPPENED, SUITE, assert_plain, drop, flat, shimmy, split_info, theirs

from impactlaw import LinearMap, Moreau, Newton
from impactlaw.envs import ImpactLaw, placed_law, put_law
from impactlaw.errors import OptionError, SettledError, WrapperError

pytestmark = theirs


@pytest.mark.parametrize("legacy_step", [True, False])
@pytest.mark.parametrize("task", SUITE, ids="-".join)
def test_a_law_that_changes_nothing_in_bare_dm_control(task, legacy_step):
    short, how = {"random": 3, "time_limit": 4.0}, {"legacy_step": legacy_step}
    envs = [suite.load(*task, task_kwargs=short, environment_kwargs=how) for _ in "ab"]
    nv = envs[0].physics.model.nv
    placed = put_law(envs[0], LinearMap(np.eye(nv)), on_inadmissible="allow")
    spec, rng = envs[0].action_spec(), np.random.default_rng(0)
    collisions, kinds = 0, []
    for _ in range(round(4.0 / envs[0].control_timestep()) + 2):  # a reset, an episode, and the reset after it
        action = rng.uniform(spec.minimum, spec.maximum)
        got, wanted = (env.step(action) for env in envs)
        assert got.step_type == wanted.step_type
        kinds.append(got.step_type)
        assert (got.reward, got.discount) == (wanted.reward, wanted.discount)
        np.testing.assert_array_equal(flat(got), flat(wanted))
        for field in ("qpos", "qvel", "act", "sensordata", "xpos", "cvel", "qacc_warmstart", "time"):
            a, b = (getattr(env.physics.data, field) for env in envs)
            np.testing.assert_array_equal(a, b, err_msg=field)
        collisions += placed.info()["impact/count"]
    assert kinds[-2:] == [dm_env.StepType.LAST, dm_env.StepType.FIRST]
    assert collisions > 0 or task[0] == "ball_in_cup"
    assert_plain(split_info(placed.info())[1])


@pytest.mark.usefixtures("quiet")
def test_divergence_of_bare_dm_control_is_its_own_error():
    env = suite.load("walker", "walk")
    placed = put_law(env, "moreau", 0.5)
    env.reset()
    with env.physics.suppress_physics_errors():
        env.physics.data.qvel[0] = np.nan
        env.step(np.zeros(6))
    assert placed.diverged
    env.reset()
    env.physics.data.qvel[0] = np.nan
    with pytest.raises(PhysicsError):
        env.step(np.zeros(6))
    assert placed.info()["impact/diverged"] == 1


class Catch(dm_env.Environment):
    reset = step = observation_spec = action_spec = lambda self, *_: None


def test_what_is_no_dm_control_environment():
    with pytest.raises(WrapperError, match="no physics"):
        put_law(Catch(), "moreau", 0.5)
    with pytest.raises(WrapperError, match=r"use impactlaw\.envs\.ImpactLaw"):
        put_law(gymnasium.make("Hopper-v5"), "moreau", 0.5)


def test_a_bare_environment_has_no_wrapper():
    for env in (suite.load("hopper", "hop"), None):
        with pytest.raises(WrapperError, match=r"ImpactLaw is for a gymnasium.Env, got a .*impactlaw.envs.put_law"):
            ImpactLaw(env, "moreau", 0.5)
    several = gymnasium.make_vec("Hopper-v5", 1)
    with pytest.raises(WrapperError, match=r"SyncVectorEnv; .* each has an ImpactLaw of its own"):
        ImpactLaw(several, "moreau", 0.5)
    several.close()


def test_composer_is_followed_from_model_to_model():
    env, bare = drop(), drop()
    placed = put_law(env, "moreau", 0.9)
    rebounds, sizes = [], set()
    for _ in range(3):
        env.reset()
        bare.reset()
        sizes.add(float(env.physics.model.geom_size[1, 0]))
        seen, most = [], [-9.0, -9.0]
        for _ in range(50):
            env.step([])
            bare.step([])
            seen += placed.events
            assert placed.info()["impact/count"] == len(placed.events)
            most = [max(m, e.physics.data.qvel[2]) for m, e in zip(most, (env, bare), strict=True)]
        assert len(seen) >= 1
        assert seen[0].contacts.labels == ("ground/ball",)
        assert seen[0].impact.post_contact_velocity[0] == pytest.approx(
            -0.9 * seen[0].impact.collision.pre_contact_velocity[0]
        )
        rebounds.append(most)
    assert len(sizes) == 3
    assert all(with_law > 1.5 > without for with_law, without in rebounds)
    placed.remove()
    for task in (env, bare):
        task.random_state.seed(7)
        task.reset()
    for _ in range(50):
        assert env.step([]).reward == bare.step([]).reward
    assert placed.events == ()


def test_rigid_contacts():
    env = drop(condim=1)
    placed = put_law(env, "moreau", 1.0, contact_model="rigid")
    env.reset()
    radius, heights = env.physics.model.geom_size[1, 0], []
    for _ in range(49):
        env.step([])
        heights.append(env.physics.data.qpos[2])
        assert env.physics.data.xpos[-1, 2] == heights[-1]  # legacy_step: all derived quantities are current
    assert min(heights) > radius - 1e-9
    assert max(heights[20:]) == pytest.approx(0.4, abs=0.01)
    placed.remove()


@pytest.mark.parametrize("scheme", ["time-stepping", "event-driven"])
def test_rigid_contacts_of_a_step_remain_where_tasks_read_them(scheme):
    """A ball at rest touches with gaps of 0 up to rounding, which MuJoCo's own margins find or not by chance."""
    env = drop()
    placed = put_law(env, "moreau", 0.0, contact_model="rigid", scheme=scheme)
    env.reset()
    touches = []
    while env.physics.data.time < 0.9:
        env.step([])
        touches.append(env.physics.data.ncon)
    assert touches[0] == 0
    assert touches[-10:] == [1] * 10
    placed.remove()


@pytest.mark.parametrize("task", [("humanoid", "stand"), ("finger", "spin")], ids="-".join)
def test_what_else_mujoco_computes_after_rigid_steps_is_current(task):
    env = suite.load(*task, task_kwargs={"random": 3})
    placed = put_law(env, "moreau", 0.5, contact_model="rigid")
    env.reset()
    spec, rng = env.action_spec(), np.random.default_rng(0)
    for _ in range(30):
        env.step(rng.uniform(spec.minimum, spec.maximum))
    model, data = env.physics.model.ptr, env.physics.data.ptr
    other = copy.copy(data)
    mujoco.mj_step1(model, other)
    position = np.repeat(model.sensor_needstage < int(mujoco.mjtStage.mjSTAGE_ACC), model.sensor_dim)
    np.testing.assert_array_equal(data.sensordata[position], other.sensordata[position])
    positions = "xpos", "site_xpos", "cam_xpos", "subtree_com", "M", "qLD", "ten_length", "actuator_length"
    velocities = "cvel", "ten_velocity", "actuator_velocity", "actuator_moment", "qfrc_bias", "qfrc_passive", "energy"
    for field in positions + velocities:
        np.testing.assert_array_equal(getattr(data, field), getattr(other, field), err_msg=field)
    placed.remove()


def test_composer_through_shimmy():
    env = ImpactLaw(shimmy().DmControlCompatibilityV0(drop()), "moreau", 0.9)
    count = 0
    for _ in range(2):
        _, info = env.reset()
        assert split_info(info)[1] == NOTHING_HAPPENED
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(np.zeros(0))
            count += info["impact/count"]
            over = terminated or truncated
    assert count >= 2
    env.remove()


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_dm_control_through_shimmy_keeps_the_law(duplicate):
    env = ImpactLaw(shimmy().DmControlCompatibilityV0(suite.load("hopper", "hop")), "moreau", 0.5)
    twin = duplicate(env)
    counts = []
    for one in (env, twin):
        one.reset(seed=0)
        one.action_space.seed(0)
        counts.append([one.step(one.action_space.sample())[4]["impact/count"] for _ in range(60)])
    assert counts[0] == counts[1]
    assert sum(counts[0]) > 0


def test_bare_dm_control_gets_its_law_taken_off():
    envs = [suite.load("hopper", "hop", task_kwargs={"random": 1}) for _ in "ab"]
    put_law(envs[0], "moreau", 0.9).remove()
    rng = np.random.default_rng(0)
    for _ in range(100):
        action = rng.uniform(-1, 1, 4)
        got, wanted = (env.step(action) for env in envs)
        np.testing.assert_array_equal(flat(got), flat(wanted))


def deep(env):
    return copy.deepcopy(env)


def pickled(env):
    return pickle.loads(pickle.dumps(env))


@pytest.mark.parametrize("options", [{}, {"contact_model": "rigid"}], ids=["soft", "rigid"])
@pytest.mark.parametrize("duplicate", [deep, pickled])
def test_a_copy_of_bare_dm_control_keeps_the_law(duplicate, options):
    env = suite.load("hopper", "hop", task_kwargs={"random": 1})
    placed = put_law(env, "moreau", 0.9, **options)
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(20):
        env.step(rng.uniform(-1, 1, 4))
    placed.law = Newton(0.25)
    twin = duplicate(env)
    its = placed_law(twin)
    assert its is not placed
    assert its.law == Newton(0.25)
    counts = []
    for _ in range(60):
        action = rng.uniform(-1, 1, 4)
        np.testing.assert_array_equal(flat(env.step(action)), flat(twin.step(action)))
        assert its.info() == placed.info()
        counts.append(placed.info()["impact/count"])
    assert sum(counts) > 0
    with pytest.raises(WrapperError, match="already"):
        put_law(twin, "moreau", 0.5)
    its.remove()
    assert placed_law(twin) is None
    assert placed_law(duplicate(twin)) is None
    assert placed_law(env) is placed
    put_law(twin, "moreau", 0.5)


every_copy = pytest.mark.parametrize("duplicate", [deep, pickled, lambda physics: physics.copy(share_model=True)])


@every_copy
def test_a_copy_of_its_physics_keeps_the_law(duplicate):
    env = suite.load("hopper", "hop", task_kwargs={"random": 1})
    put_law(env, "moreau", 0.9)
    env.reset()
    twin = duplicate(env.physics)
    for _ in range(300):
        env.physics.step()
        twin.step()
        np.testing.assert_array_equal(env.physics.data.qvel, twin.data.qvel)
    bare = suite.load("hopper", "hop", task_kwargs={"random": 1})
    bare.reset()
    bare.physics.step(300)
    assert not np.array_equal(bare.physics.data.qvel, twin.data.qvel)


@every_copy
@pytest.mark.parametrize("scheme", ["time-stepping", "event-driven"])
def test_a_copy_of_its_physics_continues_where_the_original_is(duplicate, scheme):
    """Regression: it knew nothing of the last step, and was off by up to 8e-3 rad/s after a timestep in contact."""
    env = suite.load("cheetah", "run", task_kwargs={"random": 1})
    put_law(env, "moreau", 0.3, contact_model="rigid", scheme=scheme)
    env.reset()
    rng, touching = np.random.default_rng(0), 0
    for _ in range(4):
        for _ in range(15):
            env.step(rng.uniform(-0.3, 0.3, 6))
        touching += env.physics.data.ncon > 0
        twin = duplicate(env.physics)
        twin.step(3)
        env.physics.step(3)
        np.testing.assert_array_equal(env.physics.data.qvel, twin.data.qvel)
    assert touching > 2


def test_a_composer_environment_cannot_be_copied():
    env = drop()
    put_law(env, "moreau", 0.9)
    for duplicate in (deep, pickled):
        with pytest.raises(TypeError):
            duplicate(env)


def test_a_law_of_bare_dm_control_can_be_set():
    env = drop()
    placed = put_law(env, "moreau", 0.9)
    for e in (0.5, 0.25):
        placed.law = Moreau(e)
        env.reset()
        env.step([])
        while not placed.events:
            env.step([])
        impact = placed.events[0].impact
        assert impact.post_contact_velocity == pytest.approx(-e * impact.collision.pre_contact_velocity)


def test_what_is_settled_when_the_law_is_put():
    env = suite.load("walker", "walk")
    placed = put_law(env, "moreau", 0.5, rest_speed=0.25)
    assert (placed.rest_speed, placed.contact_model, placed.log, placed.log_every) == (0.25, "soft", None, 1)
    for handle in (placed, placed_law(copy.deepcopy(env))):
        for name in (
            "contact_model", "scheme", "friction", "rest_speed", "on_inadmissible", "contacts", "limits",
            "impulse_in_cfrc_ext", "log", "log_every",
        ):  # fmt: skip
            with pytest.raises(SettledError, match=f"{name} of .* is settled"):
                setattr(handle, name, 3)


def test_a_law_that_was_taken_off_cannot_be_set():
    placed = put_law(suite.load("walker", "walk"), "moreau", 0.5)
    placed.remove()
    for name in ("law", "restitution"):
        with pytest.raises(WrapperError, match=f"was removed, so that .*{name}.* would change nothing"):
            setattr(placed, name, 0.5)


def test_a_log_that_is_no_path():
    with pytest.raises(OptionError, match=r"log is the path of a file.* got 3"):
        put_law(suite.load("walker", "walk"), "moreau", 0.5, log=3)
