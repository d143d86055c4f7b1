"""A body that slides, or whose contact is too stiff for the timestep, leaves with the law's restitution."""

import itertools

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Stepper

SCENE = """<mujoco><option timestep="{timestep}" integrator="{integrator}" cone="{cone}" gravity="0 0 0">
  <flag energy="enable"/></option><default><geom solref="{solref}" friction="1 .005 .001" condim="{condim}"/></default>
  <worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="box" pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".3 .3 .1" mass="1"/></body>
  <body name="ball" pos="2 0 .1"><freejoint/><geom name="ball" size=".1" mass="1"/></body></worldbody>
  <sensor><framepos objtype="body" objname="box"/></sensor></mujoco>"""
SOFT, STIFF = "0.02 1", "-1000000 -2000"
COMPILED = "auto", "never"
INTEGRATORS = "Euler", "implicit", "implicitfast", "RK4"
LIMIT = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body><joint name="slide" type="slide"
  limited="true" range="-1 1" solreflimit="-1000000 -2000"/><geom size=".1"/></body></worldbody></mujoco>"""


def scene(solref=SOFT, *, timestep=2e-3, integrator="Euler", cone="elliptic", condim=3, share=0.5):
    """Return the model, and data in which box and ball fall at 0.3 m/s and slide at 3 m/s; the ball lands later."""
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(timestep=timestep, integrator=integrator, cone=cone, condim=condim, solref=solref)
    )
    data = mujoco.MjData(model)
    data.qpos[[2, 9]] += 0.3 * timestep * np.array([share, share + 0.3])
    data.qvel[:] = [3.0, 0.0, -0.3, 0.0, 0.0, 0.0] * 2
    return model, data


@pytest.mark.parametrize("compiled", COMPILED)
@pytest.mark.parametrize(("solref", "timestep"), [(SOFT, 2e-3), (SOFT, 1e-2), (STIFF, 2e-3), (STIFF, 1e-2)])
@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
def test_the_coefficient_is_that_of_the_law(e, solref, timestep, compiled):
    for integrator, (cone, condim), share in itertools.product(
        INTEGRATORS, (("elliptic", 3), ("elliptic", 6), ("pyramidal", 1), ("pyramidal", 4)), (0.05, 0.6)
    ):
        model, data = scene(solref, timestep=timestep, integrator=integrator, cone=cone, condim=condim, share=share)
        stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=compiled)
        stepper.step(data, 10)
        assert data.qvel[[2, 8]] == pytest.approx([0.3 * e] * 2, abs=1e-9), (integrator, cone, condim, share)


@pytest.mark.parametrize("compiled", COMPILED)
def test_limits_of_joints(compiled):
    model = mujoco.MjModel.from_xml_string(LIMIT)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.2), contact_model="soft", compiled=compiled)
    data.qpos[0], data.qvel[0] = 0.998, 2.0
    stepper.step(data, 10)
    assert data.qvel[0] == pytest.approx(-0.4, abs=1e-9)


@pytest.mark.parametrize("compiled", COMPILED)
def test_each_is_where_it_would_be_since_its_contact_closed(compiled):
    """The box touches after 0.5 of a timestep, the ball after 0.8; they collide in the second step."""
    model, data = scene()
    h, stepper = model.opt.timestep, Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    stepper.step(data, 2)
    flown = 0.3 * 0.5 * h * np.array([1.5, 1.2])
    assert data.qpos[[2, 9]] - 0.1 == pytest.approx(flown, abs=1e-9)
    np.testing.assert_allclose(data.qvel[[2, 8]], 0.15, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("compiled", COMPILED)
def test_nothing_is_moved_where_nothing_would_push(compiled):
    """A ball that does not slide is not shifted: it leaves from its depth, and its energy is right."""
    model, data = scene()
    data.qvel[[0, 6]] = 0.0
    stepper = Stepper(model, Moreau(0.9), contact_model="soft", compiled=compiled)
    stepper.step(data)
    before = data.qpos.copy()
    stepper.step(data)
    assert stepper.sums.collisions > 0
    assert data.qpos[[2, 9]] - before[[2, 9]] == pytest.approx(0.27 * model.opt.timestep, abs=1e-12)


def test_positions_and_sensors_are_those_after_it():
    model, data = scene()
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    stepper.step(data, 2)
    assert data.sensordata[2] == data.body("box").xpos[2]
    assert data.sensordata[2] > 0.1


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_in_steps_from_half_to_half(cone):
    model, data = scene(cone=cone)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for _ in range(10):
        mujoco.mj_step1(model, data)
        stepper.finish_step(data)
    assert data.qvel[[2, 8]] == pytest.approx([0.15] * 2, abs=1e-9)


def test_a_contact_that_the_law_is_not_for_is_left_alone():
    model, data = scene()
    plain = mujoco.MjData(model)
    plain.qpos[:], plain.qvel[:] = data.qpos, data.qvel
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", contacts="box/*")
    for _ in range(10):
        stepper.step(data)
        mujoco.mj_step(model, plain)
    assert data.qvel[2] == pytest.approx(0.15, abs=1e-9)
    np.testing.assert_allclose(data.qpos[7:], plain.qpos[7:], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_compiled_steps_are_those_in_python(integrator):
    for cone, solref in itertools.product(("elliptic", "pyramidal"), (SOFT, STIFF)):
        found = []
        for compiled in COMPILED:
            model, data = scene(solref, cone=cone, integrator=integrator)
            model.opt.gravity[2] = -9.81
            data.qvel[3:6] = 1.0, 2.0, 3.0
            stepper = Stepper(model, Moreau(0.7), contact_model="soft", compiled=compiled)
            stepper.step(data, 40)
            found.append(np.concatenate([data.qpos, data.qvel]))
        np.testing.assert_allclose(*found, rtol=0.0, atol=1e-10)


def test_a_batch_takes_the_same_steps_to_the_bit():
    model, data = scene()
    batch = Batch(model, Moreau(0.5), 2, contact_model="soft")
    for name in ("qpos", "qvel"):
        batch.bind(name)[:] = getattr(data, name)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    stepper.step(data, 20)
    batch.step(nstep=20)
    np.testing.assert_array_equal(batch.bind("qpos")[1], data.qpos)


@pytest.mark.parametrize("compiled", COMPILED)
def test_what_rests_is_not_moved(compiled):
    """What is deeper than it can have come within two steps was closed before; else bodies would never rest."""
    for integrator in ("Euler", "implicit", "implicitfast"):
        model, data = scene(integrator=integrator)
        h, stepper = model.opt.timestep, Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
        data.qpos[[2, 9]] = 0.1 - 0.3 * h * np.array([2.1, 3.0])
        before = data.qpos.copy()
        stepper.step(data)
        assert stepper.sums.collisions > 0
        assert data.qpos[[2, 9]] - before[[2, 9]] == pytest.approx(h * data.qvel[[2, 8]], abs=1e-12)


@pytest.mark.parametrize("compiled", COMPILED)
def test_a_ball_that_is_moved_keeps_its_spin_in_the_axes_of_the_world(compiled):
    """An impulse at its lowest point has no moment about the vertical."""
    model, data = scene()
    data.qvel[6:] = [-5.0, 5.0, -0.3, 200.0, -200.0, -75.0]
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    stepper.step(data, 10)
    spin = np.empty(3)
    mujoco.mju_rotVecQuat(spin, data.qvel[9:], data.qpos[10:])
    assert spin[2] == pytest.approx(-75.0, abs=1e-9)
    assert np.linalg.norm(spin) == pytest.approx(np.linalg.norm(data.qvel[9:]), abs=1e-9)
