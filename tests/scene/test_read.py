"""Reading contacts and collisions from a model and its state: invalid input is refused rather than misread."""

import copy

import mujoco
import numpy as np
import pytest

from impactlaw import Collision, Coulomb, Moreau, Stepper, read_contacts
from impactlaw.errors import DivergenceError, InvalidCollisionError, OptionError, SceneError
from impactlaw.models import load
from impactlaw.scene.detection import Detector


def slider():
    """Return a scene of one degree of freedom, whose single number fits into any array."""
    body = '<body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("read", [read_contacts, Collision.from_mujoco])
def test_data_of_another_model_is_refused(read):
    model, data = load("box_drop")
    for other in (slider()[1], load("ball_chain")[1]):
        with pytest.raises(SceneError, match="another model"):
            read(model, other)
    with pytest.raises(SceneError, match="got MjData and MjModel"):
        read(data, model)
    read(copy.copy(model), data)
    read(model, load("box_drop")[1])


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_position_that_is_not_finite_is_refused(number):
    """MuJoCo finds no contacts of such a body, and its mass matrix can be finite."""
    model, data = load("box_drop")
    data.qpos[0] = number
    with pytest.raises(InvalidCollisionError, match="not finite"):
        Collision.from_mujoco(model, data)
    with pytest.raises(DivergenceError, match="not finite"):
        read_contacts(model, data)
    model, data = load("juggler")
    data.mocap_pos[0, 2] = number
    with pytest.raises(InvalidCollisionError, match="mocap"):
        Collision.from_mujoco(model, data)


@pytest.mark.parametrize("within", [-1.0, np.nan, np.inf, None, "1"])
def test_a_largest_gap_that_is_none_is_refused(within):
    with pytest.raises(OptionError, match="within is a gap of 0 m or more"):
        read_contacts(*load("ball_chain"), within=within)


TOUCHING = """<mujoco><option gravity="0 0 0" integrator="RK4"/>
  <worldbody><geom name="floor" type="plane" size="3 3 1" friction=".4"/>
  <body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".2 .15 .1" condim="4" friction=".3 .02 .01"/></body>
  <body pos=".1 0 .27"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .03 .002"/></body>
  <body pos="2 0 .05"><freejoint/><geom name="ice" size=".05" condim="1" priority="1"/></body>
  <body pos="-2 0 .5"><joint name="lift" type="slide" axis="0 0 1" range="0 1" limited="true"/>
    <geom name="arm" size=".1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("limit", [0.0, 0.2], ids=["at a limit", "off it"])
def test_the_friction_that_is_read_is_that_of_a_step(limit: float):
    """The collision that is read is the first collision of an event-driven step from touching contacts."""
    model = mujoco.MjModel.from_xml_string(TOUCHING)
    data = mujoco.MjData(model)
    data.qpos[-1] = limit
    data.qvel[:] = np.random.default_rng(0).normal(size=model.nv)
    data.qvel[[2, 8, 14, 18]] = -1.0, -2.0, -1.0, -1.0
    read = Collision.from_mujoco(model, data, friction=True)
    assert read.friction is not None
    assert read.friction.coefficient.tolist() == pytest.approx(4 * [0.4, 0.4, 0.02] + [0.5, 0.5, 0.03, 0.01, 0.01])
    stepper = Stepper(model, Moreau(0.5))
    stepper.step(data)
    seen = stepper.events[0].impact
    impact = Coulomb(Moreau(0.5)).resolve(read)
    assert read.labels == seen.collision.labels
    assert seen.collision.friction is not None
    np.testing.assert_allclose(read.friction.jacobian, seen.collision.friction.jacobian, atol=1e-12)
    np.testing.assert_allclose(impact.post_velocity, seen.post_velocity, atol=1e-9)


def test_friction_is_read_only_if_it_is_asked_for_and_there():
    model, data = load("box_drop")
    data.qpos[2] = 0.1
    assert Collision.from_mujoco(model, data).friction is None
    assert Collision.from_mujoco(model, data, friction=False).friction is None
    assert Collision.from_mujoco(*slider(), friction=True).friction is None
    with pytest.raises(OptionError, match="friction is True or False"):
        Collision.from_mujoco(model, data, friction="ignore")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("tilt", [0.0, 1e-15, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 2e-3])
@pytest.mark.parametrize("direction", [0.3, 2.0, 4.5])
def test_the_gap_of_a_cylinder_that_stands_on_a_plane_has_no_error_but_rounding(tilt, direction):
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 .05"><freejoint/><geom type="cylinder" size=".1 .05"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    along, across = np.array([np.cos(direction), np.sin(direction)]), np.array([np.cos(0.2), np.sin(0.2)])
    data.qpos[[4, 5]], data.qpos[[3, 6]] = np.sin(tilt / 2) * along, np.cos(tilt / 2) * across
    gap = 0.05 * (1.0 - np.cos(tilt)) - 0.1 * np.sin(tilt)
    contacts = read_contacts(model, data, within=0.01)
    assert contacts.gap.min() == pytest.approx(gap, abs=1e-11)
    assert len(contacts) == 4


def test_a_cylinder_that_may_touch_the_plane_only_later_is_measured_exactly_then():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .05">
      <freejoint/><geom type="cylinder" size=".1 .05" contype="0" conaffinity="0"/></body></worldbody></mujoco>""")
    data, detector, tilt, direction = mujoco.MjData(model), Detector(model), 1e-8, 2.0
    data.qpos[[4, 5]] = np.sin(tilt / 2) * np.array([np.cos(direction), np.sin(direction)])
    data.qpos[[3, 6]] = np.cos(tilt / 2) * np.array([np.cos(0.2), np.sin(0.2)])
    mujoco.mj_kinematics(model, data)
    assert not len(detector.near(data, 0.01).contacts)
    for masks in (model.geom_contype, model.geom_conaffinity, model.body_contype, model.body_conaffinity):
        masks[1] = 1
    mujoco.mj_comPos(model, data)
    contacts = detector.near(data, 0.01).contacts
    assert len(contacts) == 4
    assert contacts.gap.min() == pytest.approx(-0.1 * np.sin(tilt), abs=1e-12)


def test_a_model_without_degrees_of_freedom_is_refused():
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>')
    with pytest.raises(InvalidCollisionError, match="no degrees of freedom"):
        Collision.from_mujoco(model, mujoco.MjData(model))
