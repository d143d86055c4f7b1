"""What a scene has but a step does not need takes no time, and does not leave the step to Python."""

import time

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.errors import UncompiledWarning
from impactlaw.stepping.soft.scheme import SoftStepping

BALL = '<body pos="0 0 .3"><freejoint/><geom name="ball" size=".1" mass="1"/></body>'
FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
PADDLE = '<body mocap="true" pos="0 0 .1"><geom name="paddle" type="box" size=".2 .2 .05"/></body>'


def fastest(model, way):
    """Return the time of the fastest of some steps, s."""
    data, stepper, took = mujoco.MjData(model), Stepper(model, Moreau(0.5), **way), []
    for _ in range(30):
        start = time.thread_time()
        stepper.step(data)
        took.append(time.thread_time() - start)
    return min(took)


@pytest.mark.parametrize("way", [{"contact_model": "soft"}, {"contact_model": "rigid", "scheme": "time-stepping"}])
def test_user_data_is_not_copied(way):
    """Some robots have megabytes of it: a step that copies them takes as long as a hundred others."""
    xml = f'<mujoco><size nuserdata="{{}}"/><worldbody>{FLOOR}{BALL}</worldbody></mujoco>'
    few, many = (mujoco.MjModel.from_xml_string(xml.format(count)) for count in (1, 2_000_000))
    assert fastest(many, way) < 10.0 * fastest(few, way)


def no_python(*_):
    raise AssertionError("a step was taken in Python")


@pytest.mark.filterwarnings("ignore::impactlaw.errors.UncompiledWarning")
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("steps", [1, 5])
def test_a_mocap_body_is_a_surface_only_while_it_moves(monkeypatch, integrator, steps):
    """It rests, rises by jerks, and rests again; steps are in compiled code as soon as it rests."""
    model, data = compiled(FLOOR + PADDLE + BALL, option=f'timestep="2e-3" integrator="{integrator}"')
    other, hits = mujoco.MjData(model), [0, 0]
    ours, python = (Stepper(model, Moreau(0.5), contact_model="soft", compiled=code) for code in ("auto", "never"))
    for i in range(0, 600, steps):
        moves = 200 <= i < 500 and i % 100 < 60
        for each in (data, other):
            each.mocap_pos[0, 2] += 1e-3 * steps * moves
        ours.step(data, steps)
        python.step(other, steps)
        told = [event.impact.impulse.sum() for event in ours.events]  # repeats steps, and changes none that follow
        assert told == pytest.approx([event.impact.impulse.sum() for event in python.events], rel=1e-9)
        assert np.abs(data.qvel - other.qvel).max() < 1e-10
        hits[moves] += len(told)
    assert min(hits) > 0
    monkeypatch.setattr(SoftStepping, "step", no_python)
    ours.step(data)
    data.mocap_pos[0, 2] += 1e-3
    with pytest.raises(AssertionError, match="in Python"):
        ours.step(data)


def test_a_mocap_body_that_moves_is_told():
    model, data = compiled(FLOOR + PADDLE + BALL)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto")
    stepper.step(data)
    data.mocap_pos[0, 2] += 1e-3
    with pytest.warns(UncompiledWarning, match="mocap bodies"):
        stepper.step(data)


def test_a_limit_that_a_constraint_holds_still_takes_no_part(monkeypatch):
    """A ball hits a link of which an equality holds still one joint, which rests on its limit."""
    held = """<body pos="0 0 .15"><joint name="held" type="slide" axis="1 0 0" range="0 1" limited="true" margin=".01"/>
        <joint type="slide" axis="0 0 1"/><geom name="link" type="box" size=".2 .2 .05" mass="1"/></body>"""
    joint = '<equality><joint joint1="held"/></equality>'
    model, data = compiled(held + BALL, joint, option='timestep="2e-3" gravity="0 0 0"')
    data.qvel[-4] = -1.0
    monkeypatch.setattr(SoftStepping, "step", no_python)
    stepper, told = Stepper(model, Moreau(0.5), contact_model="soft"), []
    for _ in range(100):
        stepper.step(data)
        told += stepper.events
    assert len(told) == 1
    assert data.qvel[[1, 4]] == pytest.approx([-0.75, -0.25], abs=1e-6)
