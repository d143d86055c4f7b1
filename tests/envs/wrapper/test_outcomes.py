"""The wrapper: a law without effect leaves episodes unchanged, other laws stay admissible; soft and rigid contact."""

import gymnasium
import mujoco
import numpy as np
import pytest
from wrapped import (
    BALL,
    NOTHING_HAPPENED,
    SUITE,
    V5,
    Falling,
    assert_equal,
    assert_plain,
    data_of,
    identity,
    make_any,
    model_of,
    split_info,
    theirs,
)

from impactlaw import LinearMap, Newton
from impactlaw.envs import ImpactLaw
from impactlaw.errors import WrapperError
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.scene.read import read_contacts

pytestmark = theirs


@pytest.mark.parametrize("name", [*V5, "Ant-v4", *SUITE], ids=str)
def test_a_law_that_changes_nothing(name):
    """An episode and the beginning of another one are equal, bit for bit."""
    bare, env = make_any(name), make_any(name)
    env = ImpactLaw(env, **identity(env))
    collisions = steps = 0
    bare.action_space.seed(1)
    for seed, last in enumerate((1000, 1100)):
        (observation, info), (reference, bare_info) = env.reset(seed=seed), bare.reset(seed=seed)
        assert_equal(observation, reference)
        assert_equal(split_info(info)[0], bare_info)
        assert split_info(info)[1] == NOTHING_HAPPENED
        over = False
        while not over and steps < last:
            action = bare.action_space.sample()
            got, wanted = env.step(action), bare.step(action)
            for a, b in zip(got[:4], wanted[:4], strict=True):
                assert_equal(a, b)
            own, impact = split_info(got[4])
            assert_equal(own, wanted[4])
            assert_plain(impact)
            assert impact["impact/count"] == len(env.events)
            collisions += impact["impact/count"]
            steps += 1
            over = wanted[2] or wanted[3]
    assert collisions > 0 or name in ("Pusher-v5", ("ball_in_cup", "catch"))
    env.close()
    bare.close()


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("name", [*V5, *SUITE], ids=str)
def test_random_steps(name, e):
    env, seed = ImpactLaw(make_any(name), "moreau", e, on_inadmissible="allow"), round(10 * e)
    env.action_space.seed(seed)
    env.reset(seed=seed)
    collisions = 0
    for _ in range(400):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        values = observation.values() if isinstance(observation, dict) else [observation]
        assert all(np.isfinite(value).all() for value in values)
        assert np.isfinite(reward)
        scales = [getattr(event.impact, "restitution_scale", 1.0) for event in env.events]
        assert info["impact/inadmissible"] == np.count_nonzero(np.array(scales) < 1.0)
        assert info["impact/diverged"] == 0
        assert info["impact/count"] == len(env.events)
        for event in env.events:
            impact = event.impact
            assert impact.violations.is_admissible()
            largest = max(impact.collision.kinetic_energy, 0.5 * impact.intensity**2)
            assert impact.energy_change <= 2e-12 * largest  # rounding, up to which Coulomb scales restitution
        energy = sum(event.impact.energy_change for event in env.events)
        assert info["impact/energy_change"] == pytest.approx(energy, rel=1e-12, abs=1e-12)  # rounding
        collisions += len(env.events)
        if terminated or truncated:
            env.reset()
    assert collisions > 20 or name in ("Pusher-v5", ("ball_in_cup", "catch"))
    env.close()


def test_restitution_makes_the_hopper_bounce():
    """Dropped from half a metre with limp joints: it rebounds according to the law."""
    rises = []
    for e in (0.0, 0.5, 0.9):
        env = ImpactLaw(gymnasium.make("Hopper-v5", reset_noise_scale=0.0, terminate_when_unhealthy=False), "moreau", e)
        env.reset(seed=0)
        base = env.unwrapped
        qpos = base.init_qpos.copy()
        qpos[1] += 0.5
        base.set_state(qpos, base.init_qvel)
        env.step(np.zeros(3))
        while not env.events:
            env.step(np.zeros(3))
        speed = [base.data.qvel[1]]
        speed += [env.step(np.zeros(3)) and base.data.qvel[1] for _ in range(3)]
        rises.append(max(speed))
    assert rises[0] < rises[1] < rises[2]


def test_a_law_by_name_and_keyed_by_contacts():
    others = ["floor/torso_geom", "floor/thigh_geom", "torso_geom/leg_geom", "torso_geom/foot_geom"]
    others += ["thigh_geom/foot_geom", "thigh_joint", "leg_joint", "foot_joint"]
    keyed = {("foot_geom", "floor"): 0.7, ("floor", "leg_geom"): 0.1} | dict.fromkeys(others, 0.2)
    env = ImpactLaw(gymnasium.make("Hopper-v5"), "newton", keyed)
    assert env.law == Newton({("floor", "foot_geom"): 0.7, ("floor", "leg_geom"): 0.1} | dict.fromkeys(others, 0.2))
    env.reset(seed=0)
    while not env.events:
        env.step(np.zeros(3))
    event = env.events[0]
    assert set(event.contacts.labels) == {"floor/foot_geom"}
    e = -event.impact.post_contact_velocity / event.impact.collision.pre_contact_velocity
    np.testing.assert_allclose(e[event.impact.impulse > 0], 0.7)


@pytest.mark.parametrize(("scheme", "early"), [("event-driven", 2e-3), ("time-stepping", 4e-3), (None, 4e-3)])
def test_rigid_contacts(scheme, early):
    """Time stepping reverses the ball up to a timestep early, 4 mm at 2 m/s and 2 ms, but never late."""
    env = ImpactLaw(Falling(condim=1), "moreau", 1.0, contact_model="rigid", scheme=scheme)
    env.reset(seed=0)
    heights = [env.step(np.zeros(0))[0][2] for _ in range(600)]
    assert 0.1 - 1e-9 <= min(heights) <= 0.1 + early
    assert max(heights[300:]) == pytest.approx(0.3, abs=0.01)  # elastic: it returns to its initial height


def test_an_inadmissible_law_is_counted_and_projected():
    counts = {}
    for what in ("allow", "project"):
        env = ImpactLaw(Falling(), LinearMap(-1.5 * np.eye(6)), friction="ignore", on_inadmissible=what)
        env.reset(seed=0)
        while not env.events:
            info = env.step(np.zeros(0))[4]
        counts[what] = info["impact/inadmissible"], info["impact/energy_change"] > 1e-9
    assert counts == {"allow": (1, True), "project": (1, False)}


@pytest.mark.parametrize(("scheme", "opened"), [("event-driven", 0), ("time-stepping", 15)])
def test_ant_on_rigid_contact_with_friction(scheme, opened):
    """A reset leaves joints up to 0.6 rad beyond their limits; they are pushed out at once or within some steps."""
    env = ImpactLaw(gymnasium.make("Ant-v5"), "moreau", 0.0, contact_model="rigid", scheme=scheme)
    rng, kinds = np.random.default_rng(0), set()
    env.reset(seed=0)
    model, data = model_of(env), data_of(env)
    for k in range(25):
        *_, info = env.step(0.5 * rng.uniform(-1, 1, 8).astype(np.float32))
        assert not info["impact/diverged"]
        assert info["impact/energy_change"] <= 1e-9
        if k >= opened:
            assert read_contacts(model, data).gap.min(initial=0.0) > -1e-6
        kinds |= {type(event.impact) for event in env.events}
    assert FrictionImpact in kinds
    env.close()


def test_a_robot_of_several_agents():
    robotics = pytest.importorskip("gymnasium_robotics", reason="its robots of several agents are not tested")
    env = robotics.mamujoco_v1.parallel_env("Ant", "2x4")
    with pytest.raises(WrapperError, match=r"env.single_agent_env = ImpactLaw\("):
        ImpactLaw(env, "moreau", 0.5)
    env.single_agent_env = ImpactLaw(env.single_agent_env, "moreau", 0.5)
    env.reset(seed=0)
    count = 0
    for _ in range(12):
        *_, infos = env.step({agent: np.zeros(env.action_space(agent).shape) for agent in env.agents})
        assert {info["impact/law"] for info in infos.values()} == {"Moreau(restitution=0.5)"}
        count += infos["agent_0"]["impact/count"]
    assert count > 0


def test_gymnasium_robotics():
    robotics = pytest.importorskip(
        "gymnasium_robotics.envs.robot_env", reason="gymnasium-robotics is not installed: its robots are not tested"
    )

    class Robot(robotics.MujocoRobotEnv):
        def _initialize_simulation(self):
            self.model = mujoco.MjModel.from_xml_string(BALL)
            self.data = mujoco.MjData(self.model)
            self.initial_time, self.initial_qvel = 0.0, self.data.qvel.copy()
            self.initial_qpos = self.data.qpos.copy()

        def _get_obs(self):
            return dict.fromkeys(("observation", "achieved_goal", "desired_goal"), self.data.qpos.copy())

        def _set_action(self, action):
            pass

        def _sample_goal(self):
            return np.zeros(7)

        def _is_success(self, achieved_goal, desired_goal):
            return False

        def compute_reward(self, achieved_goal, desired_goal, info):
            return 0.0

    def robot():
        return Robot(model_path=__file__, initial_qpos={}, n_actions=1, n_substeps=20)

    bare, same, bouncing = robot(), ImpactLaw(robot(), LinearMap(np.eye(6)), on_inadmissible="allow"), robot()
    bouncing = ImpactLaw(bouncing, "moreau", 1.0)
    for env in (bare, same, bouncing):
        env.reset(seed=0)
    counts = np.zeros(2, int)
    speeds = []
    for _ in range(12):
        observation, *_ = bare.step(np.zeros(1, np.float32))
        got, *_, info = same.step(np.zeros(1, np.float32))
        assert_equal(got, observation)
        *_, other = bouncing.step(np.zeros(1, np.float32))
        counts += info["impact/count"], other["impact/count"]
        speeds.append((bouncing.unwrapped.data.qvel[2], bare.data.qvel[2]))
    assert (counts > 0).all()
    assert max(s[0] for s in speeds) > 1.5 > max(s[1] for s in speeds)
