"""Contacts that are tuned to bounce add no speed to the outcome of the law."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

TABLE_TENNIS = "0.1 0.03"
AIR_HOCKEY = "-500000 -250"
FETCH = "-10000 -30"
SCENE = """<mujoco><option timestep="0.002" integrator="{integrator}" cone="{cone}"/><default><geom solref="{solref}"/>
  </default><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom name="ball" size=".1" mass="1" condim="{condim}"/></body></worldbody></mujoco>"""
LIMIT = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body><joint name="slide" type="slide"
  limited="true" range="-1 1" solreflimit="0.1 0.03"/><geom size=".1"/></body></worldbody></mujoco>"""


def model_of(solref=TABLE_TENNIS, integrator="Euler", cone="pyramidal", condim=3):
    return mujoco.MjModel.from_xml_string(SCENE.format(solref=solref, integrator=integrator, cone=cone, condim=condim))


def effective(model, advance, height):
    """Return the ratio of the largest speed after the first collision to the speed before."""
    data = mujoco.MjData(model)
    data.qpos[2] += height
    before = after = 0.0
    while after < 0.05 or data.qvel[2] > after - 0.2:
        advance(data)
        before, after = max(before, -data.qvel[2]), max(after, data.qvel[2])
        if data.time > 1.2:
            break
    return after / before


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("solref", [TABLE_TENNIS, AIR_HOCKEY, FETCH])
def test_a_ball_bounces_with_the_coefficient_of_the_law(solref, compiled, e):
    model = model_of(solref)
    for height in (0.2, 0.31, 0.5):
        stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=compiled)
        assert effective(model, stepper.step, height) == pytest.approx(e, abs=0.055 if e == 0.0 else 0.02)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
@pytest.mark.parametrize(("cone", "condim"), [("pyramidal", 1), ("pyramidal", 3), ("elliptic", 4)])
def test_under_all_integrators_and_cones(integrator, cone, condim):
    model, found = model_of(integrator=integrator, cone=cone, condim=condim), []
    for compiled in ("auto", "never"):
        stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
        found.append(effective(model, stepper.step, 0.31))
    assert found == pytest.approx([0.5, 0.5], abs=0.02)
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_in_steps_from_half_to_half():
    model = model_of()
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")

    def advance(data):
        mujoco.mj_step1(model, data)
        stepper.finish_step(data)

    assert effective(model, advance, 0.31) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_limits_of_joints(compiled):
    model = mujoco.MjModel.from_xml_string(LIMIT)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    data.qpos[0], data.qvel[0] = 0.99, 2.0
    stepper.step(data, 50)
    assert data.qvel[0] == pytest.approx(-1.0, abs=0.01)


def test_contacts_that_the_law_is_not_for_bounce_as_in_mujoco():
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(solref=TABLE_TENNIS, integrator="Euler", cone="pyramidal", condim=3).replace(
            "</worldbody>", '<body pos="3 0 .1"><freejoint/><geom name="other" size=".1"/></body></worldbody>'
        )
    )
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", contacts="other/*")
    assert effective(model, stepper.step, 0.31) == effective(model, lambda data: mujoco.mj_step(model, data), 0.31)


def test_what_rests_rests_as_in_mujoco():
    model = model_of(FETCH)
    ours, plain = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for _ in range(2000):
        stepper.step(ours)
        mujoco.mj_step(model, plain)
    np.testing.assert_array_equal(ours.qpos, plain.qpos)


GRIP = """<mujoco><option timestep="0.002"/><default><geom solref="-10000 -30" type="box"/></default><worldbody>
  <body pos="-.12 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1 .1 .1" mass="1"/></body>
  <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><geom size=".02 .02 .02" mass=".02"/></body>
  <body pos=".12 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_strong_grip_is_that_of_mujoco(compiled):
    """Fingers that close slowly press 40 N on 20 g: the springs are compressed, but no body moves fast."""
    model = mujoco.MjModel.from_xml_string(GRIP)
    ours, plain = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    for step in range(2000):
        for data in (ours, plain):
            data.qfrc_applied[[0, 3]] = np.array([40.0, -40.0]) * min(1.0, step / 1000)
        stepper.step(ours)
        mujoco.mj_step(model, plain)
    np.testing.assert_allclose(ours.qpos, plain.qpos, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("solref", [TABLE_TENNIS, ".02 1"])
def test_springs_that_are_not_made_yet_are_not_looked_at(monkeypatch, solref):
    """The integrator "discrete" computes them in `mj_step2`; before that, ``efc_KBIP`` holds leftovers in memory."""
    model, data = model_of(solref, "discrete"), None
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    monkeypatch.setattr("impactlaw.stepping.soft.scheme.bounces", lambda data: 1 / 0)
    data = mujoco.MjData(model)
    data.qvel[2] = -1.0
    for _ in range(200):
        stepper.step(data)
    assert data.ncon or abs(data.qvel[2]) > 0.01
