"""Compiled soft steps equal MuJoCo's without a collision, and those of the scheme in Python with one."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Coulomb, Fremond, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import UncompiledWarning
from impactlaw.stepping.impact_event import ImpactSums
from impactlaw.stepping.soft.compiled.stepping import CompiledSoftStepping
from impactlaw.stepping.soft.scheme import SoftStepping

HEAP = """<geom name="floor" type="plane" size="5 5 .1"/>
    <body pos="0 0 .4" euler="20 30 0"><freejoint/><geom name="box" type="box" size=".1 .15 .05" condim="4"/></body>
    <body pos=".05 0 .7" euler="50 10 0"><freejoint/><geom name="pill" type="capsule" size=".05 .1" condim="6"
      friction=".6 .02 .01"/></body>
    <body pos="0 .1 1.0"><freejoint/><geom name="ball" size=".08" density="200" condim="1"/></body>
    <body pos="-.6 0 .5"><joint name="arm" axis="0 1 0" limited="true" range="-15 15"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body>"""
LAWS = {
    "moreau": Moreau(0.5),
    "elastic": Moreau(1.0),
    "pairs": Newton({("ball", "floor"): 0.9, ("box", "floor"): 0.2, "arm": 0.3}, default=0.6),
    "tangential": Coulomb(Moreau(0.4), tangential_restitution=0.3),
}


def steppers(model, law, **options):
    """Return a compiled stepper and one in Python."""
    ours = Stepper(model, law, contact_model="soft", compiled="auto", **options)
    assert isinstance(ours.stepping, CompiledSoftStepping)
    return ours, Stepper(model, law, contact_model="soft", compiled="never", **options)


def is_indeterminate(ours, python, start, qvel, velocity):
    """Return whether rounding decides: friction of almost coincident contacts may have many solutions.

    It does if changes of 1e-13 lead Python to another velocity, or compiled code to the velocity of Python.
    """
    data, rng = mujoco.MjData(python.model), np.random.default_rng(0)
    for _ in range(20):
        changed = qvel * (1.0 + 1e-13 * rng.standard_normal(len(qvel)))
        for stepper in (ours, python):
            mujoco.mj_setState(python.model, data, start, mujoco.mjtState.mjSTATE_INTEGRATION)
            data.qvel[:] = changed
            stepper.step(data)
            assert all(event.impact.residual < 1e-9 for event in stepper.events)
            if (np.abs(data.qvel - velocity).max() > 1e-10) == (stepper is python):
                return True
    return False


def compare(ours, python, data, other):
    """Take a step from the same state; return whether bodies collided, None if rounding decides the outcome."""
    state = np.empty(mujoco.mj_stateSize(ours.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(ours.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    before = data.qvel.copy()
    mujoco.mj_copyData(other, ours.model, data)
    ours.step(data)
    python.step(other)
    speed = max(1.0, np.abs(other.qvel).max())
    differs = np.abs(data.qvel - other.qvel).max() > 1e-10 * speed
    if differs and is_indeterminate(ours, python, state, before, other.qvel):
        return None
    tolerance = 1e-10 * speed if python.events else 0.0
    np.testing.assert_allclose(data.qvel, other.qvel, rtol=0, atol=tolerance)
    np.testing.assert_allclose(data.qpos, other.qpos, rtol=0, atol=tolerance)
    np.testing.assert_allclose(ours.sums[:4], python.sums[:4], rtol=1e-7, atol=1e-9)
    assert ours.sums.inadmissible == python.sums.inadmissible
    assert all(event.impact.violations.is_admissible() for event in python.events)
    return bool(python.events)


@pytest.mark.parametrize("name", ["Hopper-v5", "Ant-v5", "Humanoid-v5"])
@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
def test_robots(name, friction):
    env = gymnasium.make(name).unwrapped
    model, data = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    ours, python = steppers(model, Moreau(0.5), friction=friction)
    other, rng, found = mujoco.MjData(model), np.random.default_rng(0), []
    for step in range(600):
        if step % 200 == 0:
            env.reset(seed=step)
        if step % 10 == 0:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        found.append(compare(ours, python, data, other))
    assert 20 < found.count(True) < 500
    assert found.count(None) <= 0.05 * found.count(True)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize(
    "option",
    [
        'integrator="Euler" cone="pyramidal" jacobian="dense"',
        'integrator="implicitfast" cone="elliptic" jacobian="sparse"',
        'integrator="RK4" cone="pyramidal" jacobian="sparse"',
        'integrator="RK4" cone="elliptic" jacobian="dense"',
    ],
)
def test_a_heap(law, option):
    found = []
    for seed in range(3):
        model, data = compiled(HEAP, option=f'timestep="2e-3" {option}')
        data.qvel[:] += 1e-3 * np.random.default_rng(seed).normal(size=model.nv)
        ours, python = steppers(model, law)
        other = mujoco.MjData(model)
        found += [compare(ours, python, data, other) for _ in range(300)]
    assert found.count(True) > 20
    assert found.count(None) <= 0.05 * found.count(True)


@pytest.mark.parametrize("law", [Moreau(1.0), Newton({}, default=0.9)], ids=["moreau", "newton"])
def test_rods_far_from_each_other(law):
    """The energy that one of them would gain is not balanced against losses of others in the same step."""
    rods = "".join(
        f'<body pos="{3 * i} 0 .81"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia=".33 .33 .33"/>'
        f'<geom size=".01" pos=".6 0 -.8" friction="{0.05 * i}"/></body>'
        for i in range(8)
    )
    floor = '<geom type="plane" size="30 9 1" friction="0"/>'
    model, data = compiled(floor + rods, option='gravity="0 0 0" timestep="1e-3"')
    ours, python = steppers(model, law)
    other, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(60):
        data.qpos[:], data.qvel[:] = 0.0, rng.uniform(-1.0, 1.0, model.nv)
        data.qpos[1::3], data.qvel[1::3] = -1e-6, rng.uniform(-1.0, -0.5, 8)
        mujoco.mj_forward(model, data)
        assert compare(ours, python, data, other)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete", "RK4"])
def test_without_a_collision_it_is_mujoco_bit_for_bit(integrator):
    model, data = compiled(HEAP, option=f'timestep="2e-3" integrator="{integrator}"')
    stepper, reference = Stepper(model, Moreau(0.5), contact_model="soft", rest_speed=1e9), mujoco.MjData(model)
    touched = 0
    for _ in range(500):
        stepper.step(data)
        mujoco.mj_step(model, reference)
        touched += data.ncon > 0
        for field in (
            "qpos",
            "qvel",
            "qacc",
            "efc_force",
            "qacc_warmstart",
            "sensordata",
            "xpos",
            "cfrc_ext",
            "maxuse_efc",
        ):
            np.testing.assert_array_equal(getattr(data, field), getattr(reference, field), err_msg=field)
    assert touched > 100


def test_events_are_those_of_the_steps_and_sums_those_of_the_events():
    model, data = compiled(HEAP, option='timestep="2e-3"')
    ours, _ = steppers(model, Moreau(0.5))
    seen = 0
    for _ in range(100):
        before, start = data.qvel.copy(), data.time
        ours.step(data, 4)
        later, sums = ours.told, ours.sums
        if not sums.collisions:
            assert ours.events == ()
            continue
        ours.law = Moreau(0.9)  # the steps were taken under the law of that time
        events = later() if callable(later) else later
        ours.law = Moreau(0.5)
        np.testing.assert_allclose(sums, ImpactSums.of(events), rtol=1e-7, atol=1e-9)
        assert start <= events[0].time < data.time
        assert not np.array_equal(before, data.qvel)
        seen += sums.collisions
    assert seen > 20


@pytest.mark.parametrize(
    ("world", "rest", "law", "why"),
    [
        (HEAP, "", Fremond.reversal(), "all contacts of a collision at once"),
        (HEAP, "", Coulomb(Poisson(0.5)), "all contacts of a collision at once"),
        (HEAP, "", Newton(lambda speed: 0.5), "a function of speed"),
        (
            HEAP + '<geom type="box" size=".1 .1 .1" pos="2 0 0" surfacevel="1 0 0 0 0 0"/>',
            "",
            Moreau(0.5),
            "belts run",
        ),
    ],
)
def test_what_compiled_code_does_not_take_is_in_python(world, rest, law, why):
    model, data = compiled(world, rest)
    with pytest.warns(UncompiledWarning, match=why):
        ours = Stepper(model, law, contact_model="soft", compiled="auto")
    python, other = Stepper(model, law, contact_model="soft", compiled="never"), mujoco.MjData(model)
    for _ in range(250):
        ours.step(data)
        python.step(other)
    np.testing.assert_array_equal(data.qpos, other.qpos)


def test_a_callback_is_heard():
    model, data = compiled(HEAP)
    ours, python = steppers(model, Moreau(0.5))
    other, calls = mujoco.MjData(model), []
    mujoco.set_mjcb_passive(lambda m, d: calls.append(d.time))
    try:
        with pytest.warns(UncompiledWarning, match="callback"):
            ours.step(data, 3)
        python.step(other, 3)
    finally:
        mujoco.set_mjcb_passive(None)
    assert len(calls) >= 6
    np.testing.assert_array_equal(data.qpos, other.qpos)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda stepper: pickle.loads(pickle.dumps(stepper))])
def test_a_copy_goes_on(copied):
    model, data = compiled(HEAP, option='timestep="2e-3" integrator="RK4"')
    stepper = Stepper(model, LAWS["pairs"], contact_model="soft")
    stepper.step(data, 200)
    twin = copied(stepper)
    other, state = mujoco.MjData(twin.model), np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(twin.model, other, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    stepper.step(data, 200)
    twin.step(other, 200)
    assert stepper.sums.collisions == twin.sums.collisions > 0
    np.testing.assert_array_equal(data.qpos, other.qpos)


def test_an_error_of_the_engine_is_one():
    model, data = compiled(HEAP)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    stepper.step(data, 5)
    before, model.opt.integrator = data.qpos.copy(), 99
    with pytest.raises(mujoco.FatalError):
        stepper.step(data)
    model.opt.integrator = 0
    np.testing.assert_array_equal(data.qpos, before)
    stepper.step(data)


GRASP = """
    <body pos="-.1 0 0"><joint type="slide" axis="1 0 0"/>
      <geom name="left" type="box" size=".05 .03 .03" mass="5"/></body>
    <body pos=".1 0 0"><joint type="slide" axis="1 0 0"/>
      <geom name="right" type="box" size=".05 .03 .03" mass="5"/></body>
    <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>
      <geom name="block" type="box" size=".0501 .03 .03" mass=".2"/></body>"""


def closing(law, friction, **options):
    """Return steppers of two fingers that close on a block, which bounces between them, and its data."""
    model, data = compiled(GRASP, option='gravity="0 0 0"')
    data.qvel[:] = 1.0, 0.1, 0.0, 0.3, 0.0
    return *steppers(model, law, friction=friction, **options), data


@pytest.mark.parametrize("friction", ["coulomb", "convex", "ignore"])
@pytest.mark.parametrize("law", [Moreau(0.95), Newton({("left", "block"): 0.9}, default=0.95)])
def test_more_collisions_than_a_step_may_have(law, friction, monkeypatch):
    """The last collision has E = 0 and no tangential restitution, in compiled code as in Python."""
    ours, python, data = closing(law, friction, max_events=5)
    step = SoftStepping.step

    def of_python(stepping, *given):
        assert stepping is python.stepping, "compiled code leaves the step to Python"
        return step(stepping, *given)

    monkeypatch.setattr(SoftStepping, "step", of_python)
    other = mujoco.MjData(ours.model)
    assert compare(ours, python, data, other)
    assert ours.unlocated == python.unlocated == 1
    assert ours.sums.collisions == python.sums.collisions == 6
    monkeypatch.undo()
    for one, same in zip(ours.events, python.events, strict=True):
        np.testing.assert_allclose(one.impact.post_velocity, same.impact.post_velocity, rtol=0, atol=1e-10)
    assert ours.unlocated == 1, "events that are read count nothing again"
    assert len(ours.events[5].contacts) == len(ours.events[4].contacts) * 2, "the last one is of all contacts"


def test_a_step_with_just_as_many_collisions_as_it_may_have():
    ours, python, data = closing(Moreau(0.95), "coulomb")
    start = data.qvel.copy()
    ours.step(data)
    many = ours.sums.collisions
    assert 5 < many < 100
    for most, unlocated in ((many, 0), (many - 1, 1)):
        ours, python, data = closing(Moreau(0.95), "coulomb", max_events=most)
        data.qvel[:] = start
        assert compare(ours, python, data, mujoco.MjData(ours.model))
        assert ours.unlocated == python.unlocated == unlocated
