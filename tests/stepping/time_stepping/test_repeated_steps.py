"""Collisions of steps: sums without events, and events of the law that was in force."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw import Fremond, ImpactEvent, Law, Moreau, Newton, Stepper
from impactlaw.errors import SceneError
from impactlaw.models import load
from impactlaw.stepping.impact_event import NOTHING, ImpactSums, sums_of
from impactlaw.stepping.time_stepping import repeated_steps
from scripts.robots.agreement import compiled_stepper

LAWS = [Moreau(0.0), Moreau(0.5), Newton({"*": 0.7}), Fremond.reversal()]
BALL = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .101"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
ON_A_BELT = """<mujoco><worldbody>
  <body mocap="true" name="table"><geom type="box" size="1 1 .1"/></body>
  <body pos="0 0 .201"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


FINGERS = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".05 .05 .02"/>
    <body pos=".06 0 0"><joint name="a" axis="0 1 0" damping=".01"/>
      <geom type="capsule" size=".01" fromto="0 0 0 .1 0 0"/>
      <body pos=".11 0 0"><joint name="b" axis="0 1 0" damping=".01"/>
        <geom type="capsule" size=".01" fromto="0 0 0 .1 0 0"/></body></body>
    <body pos="-.06 0 0"><joint name="c" axis="0 -1 0" damping=".01"/>
      <geom type="capsule" size=".01" fromto="0 0 0 -.1 0 0"/></body></body></worldbody>
  <equality><joint joint1="b" joint2="a" polycoef="0 .7 0 0 0"/><joint joint1="c" joint2="a"/></equality></mujoco>"""


def events_asked_for(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return a list that gets, for each repeated step, whether its sums had to be found from events."""
    asked, find = [], repeated_steps.StepRepeater.sums

    def listen(repeater: repeated_steps.StepRepeater, start: repeated_steps.Start) -> ImpactSums | None:
        found = find(repeater, start)
        asked.append(found is None)
        return found

    monkeypatch.setattr(repeated_steps.StepRepeater, "sums", listen)
    return asked


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize("name", ["Hopper-v5", "Walker2d-v5", "Humanoid-v5", "rocking_block", "billiard_rack"])
def test_sums_are_those_of_the_events(name: str, law: Law, monkeypatch: pytest.MonkeyPatch):
    asked = events_asked_for(monkeypatch)
    model = gymnasium.make(name).unwrapped.model if "-" in name else load(name)[0]  # pyright: ignore[reportAttributeAccessIssue]
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qvel[:] += 0.3 * rng.normal(size=model.nv)
    stepper, collided = compiled_stepper(model, law), 0
    for _ in range(200):
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        stepper.step(data)
        sums = stepper.sums
        if not sums.collisions:
            assert stepper.events == ()
            continue
        np.testing.assert_allclose(sums, ImpactSums.of(stepper.events), rtol=1e-7, atol=1e-9)
        collided += 1
    assert collided > 0
    assert np.count_nonzero(asked) <= 0.1 * collided


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_couplings_of_joints_take_part_in_sums_without_events(restitution: float, monkeypatch: pytest.MonkeyPatch):
    """Regression: sums over collisions of robots with mimic joints took ten times as long as their steps."""
    asked = events_asked_for(monkeypatch)
    model, collided, pulled = mujoco.MjModel.from_xml_string(FINGERS), 0, 0
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(restitution), scheme="time-stepping")
    data.qvel[:] = [0.3, 0.1, -1.0, 0.5, 2.0, 0.4, 3.0, 2.1, 3.0]
    for _ in range(300):
        stepper.step(data)
        sums = stepper.sums
        if sums.collisions:
            np.testing.assert_allclose(sums, ImpactSums.of(stepper.events), rtol=1e-7, atol=1e-9)
            collided += 1
            J = np.concatenate([event.impact.collision.jacobian for event in stepper.events])
            pulled += np.count_nonzero(J[:, 6:]) > 0
    assert pulled > 3
    assert sum(asked) <= 0.1 * collided


WELDED = f"""<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="9 9 1"/>{
    "".join(
        f'<body name="{name}" pos="{0.25 * i} 0 {0.6 + 0.05 * i}" euler="20 {30 * i} 0"><freejoint/>'
        '<geom type="box" size=".1 .05 .02" mass="1"/></body>'
        for i, name in enumerate("abc")
    )
}</worldbody>
  <equality><weld body1="a" body2="b"/><weld body1="b" body2="c"/></equality></mujoco>"""
FOUR_BARS = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="9 9 1" condim="1"/>
  <body pos="0 0 .5"><freejoint/><geom type="box" size=".1 .05 .02" mass="1" condim="1"/>
    <body pos="-.08 0 -.03"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".015"/>
      <body name="a" pos="0 0 -.2"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .16 0 0" size=".015" condim="1"/></body></body>
    <body name="b" pos=".08 0 -.03"><joint axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".015" condim="1"/></body></body></worldbody>
  <equality><connect body1="b" body2="a" anchor="0 0 -.2"/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("xml", "restitution", "close"),
    [(WELDED, 0.0, 1e-7), (WELDED, 0.5, 1e-7), (FOUR_BARS, 0.5, 1e-3)],
    ids=["welded, 0", "welded, 0.5", "four bars, 0.5"],
)
def test_welds_and_connects_take_part_in_sums_without_events(
    xml: str, restitution: float, close: float, monkeypatch: pytest.MonkeyPatch
):
    """Regression: sums over collisions of robots with closed loops took ten times as long as their steps.

    Events are needed where constraints drift next to slow collisions. The lower bar lies on two contacts, which are
    redundant but for how far the loop has opened: events take them as redundant.
    """
    asked = events_asked_for(monkeypatch)
    model, collided = mujoco.MjModel.from_xml_string(xml), 0
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(restitution), scheme="time-stepping")
    data.qvel[:3] = 0.5, 0.1, -1.0
    for _ in range(400):
        stepper.step(data)
        if stepper.sums.collisions:
            np.testing.assert_allclose(stepper.sums, ImpactSums.of(stepper.events), rtol=close, atol=1e-2 * close)
            collided += 1
    assert collided > 6
    assert sum(asked) <= 0.4 * collided


def test_steps_are_taken_once_more_only_until_somebody_asks_for_sums(monkeypatch: pytest.MonkeyPatch):
    asked = events_asked_for(monkeypatch)
    stepper, data = fall(Moreau(0.5))
    stepper.step(data)
    assert not asked
    for law in (Moreau(0.5), Moreau(0.8)):
        stepper.law = law
        for _ in range(200):
            stepper.step(data)
            assert stepper.sums.collisions == len(stepper.events)
    assert asked == [False]


def test_sums_leave_the_next_steps_alone():
    model, law = gymnasium.make("Hopper-v5").unwrapped.model, Moreau(0.5)  # pyright: ignore[reportAttributeAccessIssue]
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    asking, silent = compiled_stepper(model, law), compiled_stepper(model, law)
    for _ in range(300):
        asking.step(one)
        silent.step(other)
        assert asking.sums.collisions >= 0
        np.testing.assert_array_equal(one.qvel, other.qvel)
    assert asking.short_steps == silent.short_steps


def test_sums_of_later_phases():
    """Balls that are closer than their path in a step collide one after another in one step."""
    balls = "".join(
        f'<body pos="{0.20002 * i} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'
        for i in range(3)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep=".002"/><worldbody>{balls}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper = compiled_stepper(model, Moreau(0.5))
    stepper.step(data)
    assert stepper.sums.collisions == len(stepper.events) == 3
    np.testing.assert_allclose(stepper.sums, ImpactSums.of(stepper.events), rtol=1e-7, atol=1e-9)


def test_moving_surfaces_are_told_by_events(monkeypatch: pytest.MonkeyPatch):
    asked = events_asked_for(monkeypatch)
    model = mujoco.MjModel.from_xml_string(ON_A_BELT)
    data = mujoco.MjData(model)
    stepper = compiled_stepper(model, Moreau(0.5))
    for i in range(20):
        data.mocap_pos[0, 2] = 2e-3 * i
        stepper.step(data)
        if stepper.sums.collisions:
            break
    assert stepper.sums.surface_work > 0.0
    assert asked[-1]


def fall(law: Law) -> tuple[Stepper, mujoco.MjData]:
    """Return a ball that has just hit the floor, and its data."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[2] = -1.0
    stepper = compiled_stepper(model, law)
    stepper.step(data)
    return stepper, data


def energies(events: tuple[ImpactEvent, ...]) -> list[float]:
    """Return T+ - T- of each event."""
    return [event.impact.energy_change for event in events]


def energy(events: tuple[ImpactEvent, ...]) -> float:
    """Return T+ - T- of a single event."""
    (change,) = energies(events)
    return change


def test_sums_that_a_step_was_not_to_find_are_not_those_of_a_step_before():
    """Sums are not found until they are read; a copy has the memory of its original, whose sums have been read."""
    stepper, data = fall(Moreau(0.5))
    assert stepper.sums.collisions
    stepper.step(data)
    data.qpos[2], data.qvel[2] = 0.101, -1.0
    stepper.step(data)
    other, held = copy.deepcopy(stepper), []
    for speed in (2.0, 3.0):
        data.qpos[2], data.qvel[2] = 0.101, -speed
        other.step(data)
        held.append(other.told)
    for later in held:
        np.testing.assert_allclose(sums_of(later), ImpactSums.of(later()), rtol=1e-7, atol=1e-9)


def test_a_law_set_afterwards_does_not_tell_the_collisions_of_before():
    expected = energy(fall(Moreau(0.5))[0].events)
    stepper, _ = fall(Moreau(0.5))
    stepper.law = Moreau(0.0)
    assert energy(stepper.events) == pytest.approx(expected, rel=1e-12)
    stepper, _ = fall(Moreau(0.5))
    stepper.law = Moreau(0.0)
    assert stepper.sums.energy_change == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda stepper: pickle.loads(pickle.dumps(stepper))])
def test_copies_tell_the_same(copied):
    stepper, _ = fall(Moreau(0.5))
    before, other = stepper.sums, copied(stepper)
    np.testing.assert_allclose(other.sums, before, rtol=1e-12)


@pytest.mark.parametrize("copied", [lambda told: told, copy.deepcopy])
def test_collisions_are_told_after_further_steps_and_without_their_stepper(copied):
    model, told, expected = gymnasium.make("Hopper-v5").unwrapped.model, [], []  # pyright: ignore[reportAttributeAccessIssue]
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    stepper, asking = compiled_stepper(model, Moreau(0.5)), compiled_stepper(model, Moreau(0.5))
    for _ in range(300):
        stepper.step(one)
        asking.step(other)
        if stepper.told:
            told.append(copied(stepper.told))
            expected.append(energies(asking.events))
    del stepper
    assert len(told) > 3
    assert [energies(later()) for later in told] == expected


def test_nothing_of_no_collision():
    stepper, data = fall(Moreau(1.0))
    stepper.step(data)
    assert stepper.sums is NOTHING


def test_a_changed_model_is_told():
    model = mujoco.MjModel.from_xml_string(BALL)
    stepper, data = compiled_stepper(model, Moreau(0.5)), mujoco.MjData(model)
    data.qvel[2] = -1.0
    stepper.step(data)
    model.geom_size[1] = 0.05
    with pytest.raises(SceneError, match="changed"):
        _ = stepper.events
