"""Fast balls that fly closely past edges and other balls miss them, and hit what is in their way."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

R = 0.02
TARGETS = {  # what is passed, and how far it reaches along x
    "box": ('<geom type="box" size=".3 .2 .01"/>', 0.3),
    "disc": ('<geom type="cylinder" size=".08 .005"/>', 0.08),
    "ball": ('<geom size=".05"/>', 0.05),
    "moving ball": ('<body><freejoint/><geom size=".05" mass=".1"/></body>', 0.05),
    "moving plate": ('<body><joint axis="0 1 0"/><geom type="box" size=".3 .2 .01" mass="9"/></body>', 0.3),
}
FAN = """<body pos="0 3 0"><joint axis="0 0 1"/><geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/>
    <body pos=".2 0 0"><joint axis="0 0 1"/><geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/></body></body>"""


def _flown_past(target, clearance, speed, *, time, turning=0.0):
    """Return the velocity of a ball across its way after it came past a target; its path begins so many s before.

    A fan far away from them is `turning`, rad/s, if this is not 0.
    """
    xml, edge = TARGETS[target]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody>{xml}{FAN if turning else ""}
        <body pos="{edge + R + clearance} 0 {speed * time}"><freejoint/><geom size="{R}" mass=".003"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[-4] = -speed
    if turning:
        data.qvel[-8] = turning
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
    stepper.step(data, 40)
    assert stepper.short_steps == 0
    return data.qvel[-6:-3]


@pytest.mark.parametrize("speed", [3.0, 18.0])
@pytest.mark.parametrize("target", TARGETS)
def test_what_is_missed_by_little_is_not_hit(target, speed):
    for time in np.linspace(0.02, 0.022, 7):
        assert _flown_past(target, 2e-4, speed, time=time).tolist() == [0.0, 0.0, -speed]


@pytest.mark.parametrize("speed", [3.0, 18.0])
@pytest.mark.parametrize("target", TARGETS)
def test_what_is_in_the_way_is_hit(target, speed):
    for time in np.linspace(0.02, 0.022, 7):
        assert _flown_past(target, -3e-3, speed, time=time)[0] > 0.01


@pytest.mark.parametrize("target", TARGETS)
def test_it_makes_no_difference_whether_other_bodies_turn_fast(target):
    """A fan that turns by 0.8 rad in a timestep once let balls hit all that they missed by little."""
    for time in np.linspace(0.02, 0.022, 7):
        velocity = _flown_past(target, 2e-4, 18.0, time=time, turning=400.0)
        assert velocity.tolist() == [0.0, 0.0, -18.0]


def test_a_fast_ball_bounces_off_a_thin_plate():
    """The middle of the plate is hit at 40 m/s: the ball moves by four of its radii in a timestep."""
    for time in np.linspace(0.02, 0.022, 7):
        velocity = _flown_past("box", -0.2, 40.0, time=time)
        np.testing.assert_allclose(velocity, [0.0, 0.0, 32.0], atol=1e-9)


RACKET = '<geom type="box" size=".08 .07 .003"/>'
RACKETS = {  # how a racket is carried by a mocap body
    "fixed": f'<body mocap="true">{RACKET}</body>',
    "jointed": f'<body mocap="true"><body><joint axis="0 1 0" armature="9"/>{RACKET}</body></body>',
    "swung": f'<body mocap="true"><body pos="0 .5 0">{RACKET}</body></body>',
}


def _flown_past_racket(kind, clearance, ball, racket, *, time):
    """Return the velocity of a ball after it came past the edge of a racket; both have a speed, and pass at a time."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody>{RACKETS[kind]}
        <body pos="{0.08 + R + clearance} {0.5 if kind == "swung" else 0} {ball * time}"><freejoint/>
        <geom size="{R}" mass=".003"/></body></worldbody></mujoco>"""
    )
    data, h = mujoco.MjData(model), model.opt.timestep
    data.qvel[-4] = -ball
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
    for i in range(30):
        way = racket * (i * h - time)
        if kind == "swung":
            mujoco.mju_axisAngle2Quat(data.mocap_quat[0], (1.0, 0.0, 0.0), way / 0.5)
        else:
            data.mocap_pos[0, 2] = way
        stepper.step(data)
    return data.qvel[-6:-3]


rackets = pytest.mark.parametrize("kind", RACKETS)
speeds = pytest.mark.parametrize(("ball", "racket"), [(18.0, 0.0), (9.0, 9.0), (0.0, 18.0), (1.0, 2.0)])


@rackets
@speeds
def test_a_racket_on_a_mocap_body_misses_a_ball_by_little(kind, ball, racket):
    for time in np.linspace(0.02, 0.022, 7):
        assert _flown_past_racket(kind, 2e-4, ball, racket, time=time).tolist() == [0.0, 0.0, -ball]


@rackets
@speeds
def test_a_racket_on_a_mocap_body_hits_a_ball_in_its_way(kind, ball, racket):
    for time in np.linspace(0.02, 0.022, 7):
        assert _flown_past_racket(kind, -3e-3, ball, racket, time=time)[0] > 0.01


EDGED = {"mesh": 'type="mesh" mesh="cube"', "cylinder": 'type="cylinder" size=".05 .05"'}


def _fallen_past(table, shape, clearance, speed, *, time):
    """Return the velocity of a body with edges after it fell past a table's edge; it begins so many s before."""
    cube = "-1 -1 -1 -1 -1 1 -1 1 -1 -1 1 1 1 -1 -1 1 -1 1 1 1 -1 1 1 1"
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><asset><mesh name="cube" vertex="{cube}" scale=".05 .05 .05"/></asset>
        <worldbody><geom {EDGED[table]}/><body pos="{0.1 + clearance} 0 {0.1 + speed * time}"><freejoint/>
        <geom {EDGED[shape]}/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[2] = -speed
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
    stepper.step(data, round((time + 0.2 / speed) / model.opt.timestep))
    return data.qvel[:3]


@pytest.mark.parametrize("speed", [0.5, 3.0])
@pytest.mark.parametrize("shape", EDGED)
@pytest.mark.parametrize("table", EDGED)
def test_edges_pass_each_other(table, shape, speed):
    """Regression: edges turned back where they pass each other nearer than half the way of a step."""
    for clearance in (1e-4, 1e-3):
        for time in np.linspace(0.02, 0.0215, 4):
            assert _fallen_past(table, shape, clearance, speed, time=time).tolist() == [0.0, 0.0, -speed]


@pytest.mark.parametrize("shape", EDGED)
def test_edges_that_are_in_the_way_hit_each_other(shape):
    for clearance in (-1e-3, 3e-4):
        assert (_fallen_past("mesh", shape, clearance, 3.0, time=0.021)[2] > 0.0) == (clearance < 0.0)
