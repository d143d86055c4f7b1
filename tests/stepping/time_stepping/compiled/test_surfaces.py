"""Steps with mocap bodies under a law in compiled code equal those that ask it in Python."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import gymnasium
import mujoco
import numpy as np
import pytest
from scenes import compiled

import impactlaw.envs
from impactlaw import Coulomb, Law, Moreau, Newton, Stepper
from scripts.robots.agreement import begin_alike, compiled_stepper, difference

TABLE = """<body name="table" mocap="true" pos="0 0 -.1"><geom name="table" type="box" size=".5 .5 .1"/>
  <body pos=".3 0 .2"><joint type="hinge" axis="0 1 0" range="-20 20" limited="true" damping=".01"/>
    <geom name="flap" type="box" size=".1 .1 .02"/></body></body>"""
THINGS = """<body pos="-.2 .1 .4"><freejoint/><geom name="ball" size=".07"/></body>
  <body pos="0 0 .2"><freejoint/><geom type="ellipsoid" size=".07 .05 .1" condim="4"/></body>
  <body pos=".1 -.3 .3"><freejoint/><geom type="capsule" size=".04" fromto="-.1 0 0 .1 0 0" condim="1"/></body>"""
FLOOR = '<geom name="floor" type="plane" size="3 3 1" pos="0 0 -.5"/>'
BELT = '<geom name="belt" type="box" size="1 1 .1" pos="1.2 0 -.1" surfacevel=".3 0 0 0 0 1"/>'
GHOST = '<body name="ghost" mocap="true" pos="0 0 1"><geom size=".1" contype="0" conaffinity="0"/></body>'
Move = Callable[[mujoco.MjData, float], None]


def _up_and_down(data: mujoco.MjData, t: float) -> None:
    data.mocap_pos[0, 2] = -0.1 + 0.03 * np.sin(12.0 * t)


def _turn(data: mujoco.MjData, t: float) -> None:
    axis, angle = np.array([0.6, 0.8 * np.cos(t), 0.8 * np.sin(t)]), 0.1 * np.sin(9.0 * t)
    mujoco.mju_axisAngle2Quat(data.mocap_quat[0], axis, angle)
    data.mocap_pos[0, :2] = 0.1 * np.sin(5.0 * t), 0.05 * np.cos(4.0 * t)


def _blows(data: mujoco.MjData, t: float) -> None:
    data.mocap_pos[0, 2] = -0.1 + 0.01 * (int(t / 0.1) % 2)
    data.mocap_quat[0] = np.cos(0.02 * (int(t / 0.07) % 3)), 0.0, np.sin(0.02 * (int(t / 0.07) % 3)), 0.0


def _ghost(data: mujoco.MjData, t: float) -> None:
    data.mocap_pos[-1, 0] = t


MOVES: dict[str, Move] = {"up": _up_and_down, "turn": _turn, "blows": _blows, "ghost": _ghost}
SCENES = {
    "table": TABLE + THINGS + FLOOR,
    "belt": BELT + TABLE + THINGS + FLOOR + GHOST,
    "ghost": FLOOR + THINGS + GHOST,
}
LAWS: dict[str, Law] = {
    "same": Newton({"*": 0.5}),
    "tangential": Coulomb(Newton({"*": 0.8}), tangential_restitution=0.4),
}


def _both(model: mujoco.MjModel, law: Law) -> tuple[Stepper, Stepper]:
    return compiled_stepper(model, law), Stepper(model, law, scheme="time-stepping", compiled="never")


def _step_alike(
    steppers: tuple[Stepper, Stepper], one: mujoco.MjData, other: mujoco.MjData, steps: int, move: Move
) -> int:
    """Step both from the same states and compare; return the number of collisions."""
    ours, python = steppers
    collisions = 0
    for _ in range(steps):
        move(one, one.time)
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        assert difference(one, other) < 1e-10
        assert np.array_equal(one.mocap_pos, other.mocap_pos)
        assert np.array_equal(one.mocap_quat, other.mocap_quat)
        assert len(ours.events) == len(python.events)
        for mine, theirs in zip(ours.events, python.events, strict=True):
            collisions += 1
            assert mine.contacts.labels == theirs.contacts.labels
            np.testing.assert_allclose(mine.impact.impulse, theirs.impact.impulse, atol=1e-9)
            assert mine.impact.surface_work == pytest.approx(theirs.impact.surface_work, abs=1e-9)
    return collisions


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("scene", "move"),
    [("table", "up"), ("table", "turn"), ("table", "blows"), ("belt", "turn"), ("belt", "ghost"), ("ghost", "ghost")],
)
def test_a_law_in_compiled_code_is_that_of_python(scene: str, move: str, law: str):
    model, one = compiled(SCENES[scene], option='timestep="0.004"', geom='friction=".6"')
    collisions = _step_alike(_both(model, LAWS[law]), one, mujoco.MjData(model), 300, MOVES[move])
    assert collisions > 3


@pytest.mark.parametrize("name", ["Juggler", "RockingBlock"])
def test_environments_step_alike_where_the_law_is_asked_in_python(name: str):
    env = gymnasium.make(f"impactlaw/{name}-v0", scheme="time-stepping").unwrapped
    assert isinstance(env, impactlaw.envs.ImpactEnv)
    restitution = env.law.common_coefficient
    assert restitution is not None
    (ours, python), one = _both(env.model, Newton({"*": restitution})), env.data
    other, rng, collisions = mujoco.MjData(env.model), np.random.default_rng(0), 0

    def move(data: mujoco.MjData, time: float) -> None:
        if time > 0:
            env.act(np.array([part]))
            env.drive()

    for episode in range(3):
        env.reset(seed=episode)
        for _ in range(40):
            part = rng.uniform(-1.0, 1.0)
            collisions += _step_alike((ours, python), one, other, 10, move)
    assert collisions > 3
    env.close()


def test_steppers_by_themselves_follow_the_same_path():
    """Neither stepper takes over the memory of the other."""
    table = '<body mocap="true" pos="0 0 -.1"><geom type="box" size=".5 .5 .1"/></body>'
    model, one = compiled(table + '<body pos="0 0 .2"><freejoint/><geom size=".07"/></body>')
    (ours, python), other = _both(model, Newton({"*": 0.7})), mujoco.MjData(model)
    apart = 0.0
    for _ in range(300):
        for stepper, data in ((ours, one), (python, other)):
            _up_and_down(data, data.time)
            stepper.step(data)
        apart = max(apart, difference(one, other))
    assert apart < 1e-10
    assert ours.short_steps == python.short_steps == 0


def test_a_step_that_did_not_follow_the_last_one_finds_bodies_at_rest():
    model, one = compiled(SCENES["table"])
    steppers, other = _both(model, Newton({"*": 0.5})), mujoco.MjData(model)
    _step_alike(steppers, one, other, 60, _up_and_down)
    for time in (one.time + 0.3, 0.0):
        one.time = time
        _step_alike(steppers, one, other, 60, _up_and_down)
    at_rest, moved = mujoco.MjData(model), steppers[0]
    for data in (at_rest, one):
        mujoco.mj_resetData(model, data)
        data.mocap_pos[0, 2] = -0.12
    _both(model, Newton({"*": 0.5}))[0].step(at_rest)
    moved.step(one)
    assert np.array_equal(one.qvel, at_rest.qvel)


def test_copies_go_on_alike():
    model, one = compiled(SCENES["table"])
    ours = compiled_stepper(model, Moreau(0.5))
    for _ in range(60):
        _turn(one, one.time)
        ours.step(one)
    for copied, theirs in (copy.deepcopy((ours, one)), pickle.loads(pickle.dumps((ours, one)))):
        alike, mine = copy.deepcopy((ours, one))
        for _ in range(30):
            for stepper, data in ((alike, mine), (copied, theirs)):
                _turn(data, data.time)
                stepper.step(data)
            assert np.array_equal(mine.qpos, theirs.qpos)
            assert np.array_equal(mine.qvel, theirs.qvel)


def test_steps_under_a_callback_go_on_from_the_others():
    """While a callback is set, steps pass the user's model to MuJoCo."""
    model, one = compiled(SCENES["table"])
    ours, always = (Stepper(model, Moreau(0.5), scheme="time-stepping") for _ in range(2))
    other = copy.copy(one)
    for i in range(80):
        for stepper, data in ((ours, one), (always, other)):
            _turn(data, data.time)
            if stepper is ours and 30 <= i < 33:
                mujoco.set_mjcb_control(lambda model, data: None)
            try:
                stepper.step(data)
            finally:
                mujoco.set_mjcb_control(None)
        assert difference(one, other) < 1e-8
