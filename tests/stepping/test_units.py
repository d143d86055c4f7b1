"""Scenes in centimeters and millimeters move like the same scenes in meters."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING

WAYS = {
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
}
LENGTHS = pytest.mark.parametrize("meter", [100.0, 1000.0], ids=["cm", "mm"])


def scene(meter, bodies, tendons="", integrator="RK4"):
    """Return a scene in other units of length, whose bodies are a function of lengths, and its data."""
    option = f'<option timestep="0.002" integrator="{integrator}" gravity="0 0 {-9.81 * meter}"/>'

    def lengths(*values):
        return " ".join(repr(value * meter) for value in values)

    text = f"{option}<worldbody>{bodies(lengths)}</worldbody><tendon>{tendons and tendons(lengths)}</tendon>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{text}</mujoco>")
    return model, mujoco.MjData(model)


def shaken(meter, **way):
    """Return the height, m, of a box on a table that moves up and down with at most 0.4 g, and its collisions."""
    model, data = scene(
        meter,
        lambda x: (
            f'<body mocap="true" pos="{x(0, 0, 0.1)}"><geom type="box" size="{x(0.3, 0.3, 0.1)}"/></body>'
            f'<body pos="{x(0, 0, 0.3)}"><freejoint/><geom type="box" size="{x(0.1, 0.1, 0.1)}" mass="8"/></body>'
        ),
    )
    stepper, collisions = Stepper(model, Moreau(0.5), **way), 0
    for i in range(150):
        data.mocap_pos[0, 2] = meter * (0.1 + 0.004 * (1.0 - np.cos(0.02 * np.pi * i)))
        stepper.step(data)
        collisions += stepper.sums.collisions
    return data.qpos[2] / meter, collisions


@pytest.mark.parametrize("way", WAYS)
@LENGTHS
def test_a_table_that_moves_smoothly_is_not_struck(meter, way):
    height, collisions = shaken(meter, **WAYS[way])
    expected, before = shaken(1.0, **WAYS[way])
    assert collisions == before == 0
    assert height == pytest.approx(expected, abs=1e-7)


def swung(meter):
    """Return the position of a bob on a taut rope after 0.4 s, m, and the number of its collisions."""
    model, data = scene(
        meter,
        lambda x: (
            f'<site name="hook" pos="{x(0, 0, 2)}"/><body pos="{x(0.8, 0, 2)}"><freejoint/>'
            f'<geom size="{x(0.05)}" mass="1"/><site name="bob"/></body>'
        ),
        lambda x: f'<spatial limited="true" range="0 {x(0.8)}"><site site="hook"/><site site="bob"/></spatial>',
    )
    stepper, collisions = Stepper(model, Moreau(0.0), scheme="time-stepping"), 0
    for _ in range(200):
        stepper.step(data)
        collisions += stepper.sums.collisions
    return data.qpos[:3] / meter, collisions


@LENGTHS
def test_a_rope_whose_direction_turns_does_not_collide_in_every_step(meter):
    place, collisions = swung(meter)
    expected, before = swung(1.0)
    assert max(collisions, before) <= 10  # of 200 steps: the first ones, in which the rope begins to turn
    assert place == pytest.approx(expected, abs=1e-5)


def launched(meter):
    """Return positions of two touching balls a step after one was launched at the other, m."""
    model, data = scene(
        meter,
        lambda x: "".join(
            f'<body pos="{x(0.2 * i, 0, 0)}"><joint type="slide" axis="1 0 0"/><geom size="{x(0.1)}" mass="1"/></body>'
            for i in range(2)
        ),
    )
    data.qvel[0], stepper = meter, Stepper(model, Moreau(0.5), scheme="time-stepping")
    stepper.step(data)
    return data.qpos / meter


@LENGTHS
def test_bodies_that_meet_in_the_first_step_are_moved_apart_at_once(meter):
    assert launched(meter) == pytest.approx(launched(1.0), abs=1e-7)


def test_limits_of_hinges_do_not_depend_on_the_unit_of_length():
    """A door in millimeters that is shut at 0.5 rad/s bounces off its limit with e."""
    model, data = scene(
        1000.0,
        lambda x: (
            '<body><joint axis="0 0 1" range="0 90" limited="true"/>'
            f'<geom type="box" size="{x(0.4, 0.02, 1)}" pos="{x(0.4, 0, 0)}" mass="10"/></body>'
        ),
    )
    data.qpos[0], data.qvel[0] = 0.05, -0.5
    stepper = Stepper(model, Moreau(0.6), scheme="time-stepping")
    for _ in range(100):
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(0.3, rel=1e-9)


def tumbled(meter):
    """Return where two boxes are after they have tumbled over a floor, and the number of collisions."""
    model, data = scene(
        meter,
        lambda x: (
            f'<geom type="plane" size="{x(9, 9, 1)}" friction="0.4"/>'
            f'<body pos="{x(0, 0, 0.25)}" euler="14 33 13"><freejoint/>'
            f'<geom type="box" size="{x(0.1, 0.1, 0.1)}" mass="8" friction="0.4"/></body>'
            f'<body pos="{x(0.05, 0.02, 0.55)}" euler="-52 36 18"><freejoint/>'
            f'<geom type="box" size="{x(0.1, 0.1, 0.1)}" mass="8" friction="0.4"/></body>'
        ),
    )
    stepper, collisions = Stepper(model, Moreau(0.5)), 0
    for _ in range(150):
        stepper.step(data)
        collisions += stepper.sums.collisions
    return data.qpos.reshape(2, 7)[:, :3] / meter, collisions


def test_gaps_in_millimeters_are_not_finer_than_their_rounding():
    """Contacts that open and close by rounding would collide again and again, until time stepping takes over."""
    (places, collisions), (expected, before) = tumbled(1000.0), tumbled(1.0)
    assert places == pytest.approx(expected, abs=1e-5)
    assert collisions == before


def pushed(meter, speed, turning):
    """Return the parts of their speeds with which a ball leaves a wall, m/s, and a hinge its limit, rad/s."""
    model, data = scene(
        meter,
        lambda x: (
            f'<geom type="box" pos="{x(0.3, 0, 0)}" size="{x(0.1, 0.1, 0.1)}"/>'
            f'<body pos="{x(0.0999, 0, 0)}"><joint type="slide" axis="1 0 0"/><geom size="{x(0.1)}" mass="1"/></body>'
            f'<body pos="{x(0, 1, 0)}"><joint range="-1 1" limited="true"/><geom size="{x(0.1)}" mass="1"/></body>'
        ),
    )
    data.qpos[1], data.qvel[:] = np.deg2rad(1) - 1e-6, (speed * meter, turning)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(300):
        stepper.step(data)
    return tuple(data.qvel / (speed * meter, turning))


@pytest.mark.parametrize("meter", [1.0, 100.0, 1000.0], ids=["m", "cm", "mm"])
def test_the_slowest_collision_is_as_slow_in_other_units(meter):
    """It is 1e-3 m/s of contacts, and 1e-3 rad/s of limits of hinges, which have no unit of length."""
    assert pushed(meter, 1.1e-3, 1.1e-3) == pytest.approx((-0.5, -0.5), abs=1e-9)
    assert pushed(meter, 0.9e-3, 0.9e-3) == pytest.approx((0.0, 0.0), abs=1e-9)


@LENGTHS
def test_bodies_at_rest_touch_across_as_small_gaps(meter):
    found = [Stepper(scene(each, lambda x: "")[0], Moreau(0.5), scheme="time-stepping") for each in (1.0, meter)]
    one, other = (stepper.stepping.law.settings()[SETTING.touching] for stepper in found)
    assert other == pytest.approx(meter * one)
