"""Environments to put a law on, and comparisons of them."""

from typing import ClassVar

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import composer
from gymnasium.envs.mujoco import MujocoEnv

from impactlaw import LinearMap
from impactlaw.envs import ImpactLaw

V5 = ("Ant-v5", "Humanoid-v5", "Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Pusher-v5")
SUITE = (("hopper", "hop"), ("cheetah", "run"), ("ball_in_cup", "catch"), ("walker", "walk"))
INFO = ("count", "energy_change", "surface_work", "intensity", "distant", "inadmissible", "short", "diverged")
FLOATS = ("impact/energy_change", "impact/surface_work", "impact/intensity")
NOTHING_HAPPENED = {f"impact/{name}": 0 for name in INFO}
BALL = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
<body pos="0 0 .3"><freejoint/><geom name="ball" type="sphere" size=".1"/></body></worldbody></mujoco>"""

theirs = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:.*settotalmass.*", "ignore:.*out of date.*")
"""Warnings of the wrapped packages about themselves."""


def shimmy():
    why = "shimmy is not installed: dm_control through gymnasium is not tested"
    return pytest.importorskip("shimmy.dm_control_compatibility", reason=why)


def shimmy_task(domain, task):
    shimmy()
    return gymnasium.make(f"dm_control/{domain}-{task}-v0")


def make_any(name):
    return gymnasium.make(name) if isinstance(name, str) else shimmy_task(*name)


def model_of(env):
    base = env.unwrapped
    return base.model if hasattr(base, "model") else base._env.physics.model.ptr


def data_of(env):
    base = env.unwrapped
    return base.data if hasattr(base, "model") else base._env.physics.data.ptr


def identity(env):
    return {"law": LinearMap(np.eye(model_of(env).nv)), "on_inadmissible": "allow"}


def split_info(info):
    """Return the environment's own part of info and the part of the law, after checks of its name and restitution."""
    info = dict(info)
    assert isinstance(info.pop("impact/law"), str)
    assert type(info.pop("impact/restitution", 0.0)) is float
    return (
        {key: value for key, value in info.items() if not key.startswith("impact/")},
        {key: value for key, value in info.items() if key.startswith("impact/")},
    )


def assert_equal(a, b):
    assert type(a) is type(b)
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_equal(a[key], b[key])
    else:
        np.testing.assert_array_equal(a, b)


def assert_plain(info):
    assert set(info) == set(NOTHING_HAPPENED)
    for key, value in info.items():
        assert type(value) is (float if key in FLOATS else int), key


def flat(timestep):
    return np.concatenate([np.ravel(value) for value in timestep.observation.values()])


def hopper(**options):
    return ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, **options)


class Falling(MujocoEnv):
    """A ball that falls; it is copied attribute by attribute."""

    metadata: ClassVar = {"render_modes": [], "render_fps": 500}

    def __init__(self, condim=3, *, xml=None, frame_skip=1):
        self._xml = BALL.replace("<geom", f'<geom condim="{condim}"') if xml is None else xml
        space = gymnasium.spaces.Box(-np.inf, np.inf, (7,), np.float64)
        super().__init__("hopper.xml", frame_skip, space)

    def _initialize_simulation(self):
        model = mujoco.MjModel.from_xml_string(self._xml)
        return model, mujoco.MjData(model)

    def _set_action_space(self):
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (0,))

    def step(self, action):
        self.do_simulation(action, self.frame_skip)
        return self.data.qpos.copy(), 0.0, False, False, {}

    def reset_model(self):
        self.set_state(self.init_qpos, self.init_qvel)
        return self.data.qpos.copy()


class Drop(composer.Task):
    """A ball with another size in every episode."""

    def __init__(self, condim=3):
        self._arena = composer.Arena()
        world = self._arena.mjcf_model.worldbody
        world.add("geom", name="ground", type="plane", size=(2, 2, 0.1), condim=condim)
        body = world.add("body", name="ball", pos=(0, 0, 0.4))
        body.add("freejoint")
        self._geom = body.add("geom", name="ball", type="sphere", size=(0.1,), condim=condim)
        self.set_timesteps(control_timestep=0.02, physics_timestep=0.002)

    @property
    def root_entity(self):
        return self._arena

    def initialize_episode_mjcf(self, random_state):
        self._geom.size = (random_state.uniform(0.05, 0.15),)

    def get_reward(self, physics):
        return float(physics.data.qpos[2])


def drop(seed=0, condim=3):
    return composer.Environment(Drop(condim), time_limit=1.0, random_state=seed)
