"""Bodies at rest stay at rest, sliding bodies stop at the right place, and no block hops."""

import math

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Fremond, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.models import load

G = 9.81
LAWS = {
    "maximal dissipation": MaximalDissipation(),
    "moreau": Moreau(0.5),
    "newton": Newton(0.8),
    "newton of speed": Newton(lambda speed: 0.5),
    "poisson": Poisson(0.5),
    "reversal": Fremond.reversal(),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def box(name="box", z=0.125, size=0.125, mass=1, x=0.0):
    return f"""<body name="{name}" pos="{x} 0 {z}"><freejoint/>
        <geom name="{name}" type="box" size="{size} {size} {size}" mass="{mass}"/></body>"""


def assert_stays(model, data, law, steps):
    start = data.qpos.copy()
    stepper = stepping(model, law)
    for _ in range(steps):
        stepper.step(data)
        assert stepper.events == ()
    assert data.qpos == pytest.approx(start, abs=1e-9)
    assert abs(data.qvel).max() < 1e-9


@every_law
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_a_box_at_rest_stays(law, condim):
    model, data = compiled(FLOOR + box(), geom=f'condim="{condim}"')
    assert_stays(model, data, law, 300)


@pytest.mark.parametrize("timestep", [1e-4, 1e-2, 0.05])
@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_a_box_stays_at_any_timestep_and_integrator(integrator, timestep):
    model, data = compiled(FLOOR + box(), option=f'timestep="{timestep}" integrator="{integrator}"')
    assert_stays(model, data, Moreau(0.5), 200)


@pytest.mark.parametrize("height", [0.2, 0.205, 0.215, 0.235, 0.3])
def test_a_box_that_lands_flat_stays_flat(height):
    # one step above the floor its speed is just the limit at which corners collide: rounding must not choose among them
    model, data = compiled(FLOOR + box(z=height, size=0.1).replace("<body", '<body euler="0 0 33.3"'))
    data.qvel[:2] = 0.3, -0.2
    stepper = stepping(model, MaximalDissipation())
    for _ in range(150):
        stepper.step(data)
        assert abs(data.qpos[4:6]).max() < 1e-9
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)


@every_law
@pytest.mark.parametrize("condim", [1, 3])
def test_a_stack_of_twenty_boxes_stays(law, condim):
    stack = "".join(box(f"box{i}", 0.125 + 0.25 * i) for i in range(20))
    model, data = compiled(FLOOR + stack, geom=f'condim="{condim}"')
    assert_stays(model, data, law, 25)


@pytest.mark.parametrize("ratio", [1e-3, 1e3])
def test_a_stack_of_unequal_boxes_stays(ratio):
    stack = "".join(box(f"box{i}", 0.125 + 0.25 * i, mass=ratio ** (i % 2)) for i in range(6))
    model, data = compiled(FLOOR + stack)
    assert_stays(model, data, Moreau(0.5), 50)


def test_the_columns_of_balls_come_to_rest_and_stay():
    model, data = load("ball_stack")
    stepper = stepping(model, Moreau(0.0))
    run(stepper, data, 400)
    assert_stays(model, data, Moreau(0.5), 100)


@every_law
@pytest.mark.parametrize("kind", ["sphere", "capsule", "ellipsoid", "cylinder", "mesh"])
def test_other_shapes_at_rest_stay(law, kind):
    size = {
        "sphere": 'size=".1"',
        "capsule": 'size=".1 .2" euler="90 0 0"',
        "ellipsoid": 'size=".2 .15 .1"',
        "cylinder": 'size=".15 .1"',
        "mesh": 'mesh="tent"',
    }[kind]
    mesh = '<asset><mesh name="tent" vertex="-.2 -.2 -.1 .2 -.2 -.1 -.2 .2 -.1 .2 .2 -.1 0 0 .2"/></asset>'
    body = f'<body pos="0 0 .1"><freejoint/><geom name="thing" type="{kind}" {size} mass="1"/></body>'
    model, data = compiled(FLOOR + body, mesh)
    mujoco.mj_forward(model, data)
    data.qpos[2] -= min(contact.dist for contact in data.contact) if data.ncon else 0.0
    if kind == "mesh":
        data.qpos[2] += 1e-12  # the origin of the mesh is its centre of mass
    mujoco.mj_forward(model, data)
    assert_stays(model, data, law, 100)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_a_dropped_box_comes_to_rest_on_the_floor(e):
    model, data = compiled(FLOOR + box(z=0.145), option='timestep="5e-3"')
    stepper = stepping(model, Moreau(e))
    run(stepper, data, 400)
    height = data.qpos[2]
    assert height == pytest.approx(0.125, abs=1e-5)
    assert run(stepper, data, 100) == []
    assert data.qpos[2] == pytest.approx(height, abs=1e-9)
    assert abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("condim", [3, 4, 6])
def test_a_box_below_the_friction_angle_stays_and_one_above_slides_by_the_closed_form(condim):
    angle = 0.3
    for mu in (1.01 * math.tan(angle), 0.9 * math.tan(angle)):
        option = f'gravity="{G * math.sin(angle)} 0 {-G * math.cos(angle)}"'
        geom = f'condim="{condim}" friction="{mu} 0.005 0.0001"'
        model, data = compiled(FLOOR + box(), option=option, geom=geom)
        run(stepping(model, Moreau(0.5)), data, 500)
        acceleration = max(0.0, G * math.sin(angle) - mu * G * math.cos(angle))
        assert data.qvel[0] == pytest.approx(acceleration * data.time, abs=1e-8)
        assert data.qpos[0] == pytest.approx(0.5 * acceleration * data.time**2, abs=1e-8)
        assert data.qpos[2] == pytest.approx(0.125, abs=1e-9)


def slide(timestep, friction, law=None):
    """Slide a block at 2 m/s on a floor with mu = 0.3; return distance, largest height of its centre, final speed."""
    model, data = compiled(FLOOR + box(), option=f'timestep="{timestep}"', geom='friction=".3"')
    data.qvel[0] = 2.0
    stepper, highest = stepping(model, law or Newton(0.5), friction=friction), 0.0
    for _ in range(round(0.8 / timestep)):
        stepper.step(data)
        highest = max(highest, abs(data.qpos[2] - 0.125))
    return data.qpos[0], highest, data.qvel[0]


@every_law
def test_a_sliding_block_stops_at_its_distance_and_never_hops(law):
    errors = []
    for timestep in (8e-3, 4e-3, 2e-3):
        distance, highest, speed = slide(timestep, "coulomb", law)
        assert highest < 1e-9
        assert abs(speed) < 1e-9
        errors.append(abs(distance - 2.0**2 / (2 * 0.3 * G)))
    for error, timestep in zip(errors, (8e-3, 4e-3, 2e-3), strict=True):
        assert error < 0.3 * G * timestep**2 / 8 + 1e-8


def test_the_convex_relaxation_lets_the_block_hop_and_no_friction_lets_it_go():
    assert slide(2e-3, "convex")[1] > 1e-4
    distance, highest, speed = slide(2e-3, "ignore")
    assert distance == pytest.approx(1.6, abs=1e-9)
    assert speed == pytest.approx(2.0, abs=1e-12)
    assert highest < 1e-9


def test_a_spinning_ball_is_stopped_by_torsional_friction_in_the_closed_form_time():
    """I = 2/5 m r^2, moment mu_t m g: w decreases by mu_t m g / I per second, and the ball stays in place."""
    ball = '<body pos="0 0 .1"><freejoint/><geom size=".1" mass="2"/></body>'
    model, data = compiled(FLOOR + ball, geom='condim="4" friction="1 .01 0"')
    data.qvel[5] = 5.0
    rate = 0.01 * 2 * G / (0.4 * 2 * 0.1**2)
    stepper = stepping(model, Moreau(0))
    while data.time < 0.3:
        stepper.step(data)
        assert data.qvel[5] == pytest.approx(max(0.0, 5.0 - rate * data.time), abs=1e-8)
    assert data.qpos[:3] == pytest.approx([0, 0, 0.1], abs=1e-9)
    assert data.qvel == pytest.approx(np.zeros(6), abs=1e-9)


def test_a_ball_that_slides_rolls_in_the_end_with_five_sevenths_of_its_speed():
    ball = '<body pos="0 0 .1"><freejoint/><geom size=".1" mass="2"/></body>'
    model, data = compiled(FLOOR + ball, geom='condim="3" friction=".2"')
    data.qvel[0] = 3.0
    run(stepping(model, Moreau(0)), data, 400)
    assert data.qvel[[0, 4]] == pytest.approx([15 / 7, 15 / 7 / 0.1], abs=1e-7)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)


def test_rolling_friction_stops_a_rolling_ball():
    """While it rolls, ``(m r^2 + I) dw/dt = -mu_r m g``; the friction needed is far below its bound."""
    ball = '<body pos="0 0 .1"><freejoint/><geom size=".1" mass="2"/></body>'
    mu_r = 5e-3
    model, data = compiled(FLOOR + ball, geom=f'condim="6" friction="1 .1 {mu_r}"')
    data.qvel[[0, 4]] = 0.2, 2.0
    rate = mu_r * 2 * G / (1.4 * 2 * 0.1**2)
    run(stepping(model, Moreau(0)), data, 100)
    assert data.qvel[4] == pytest.approx(2.0 - rate * 0.2, rel=1e-3)
    assert data.qvel[0] == pytest.approx(0.1 * data.qvel[4], abs=1e-3)
    run(stepping(model, Moreau(0)), data, 300)
    assert abs(data.qvel).max() < 1e-8


def test_condim_1_has_no_friction_whatever_the_coefficients():
    model, data = compiled(FLOOR + box(), geom='condim="1" friction="1 1 1"')
    data.qvel[0] = 1.0
    run(stepping(model, Moreau(0)), data, 100)
    assert data.qvel[0] == pytest.approx(1.0, abs=1e-12)


def test_dry_friction_holds_a_hinge_against_gravity_and_yields_beyond_its_bound():
    """A rod of 1 kg at 0.5 m pulls with 4.905 N m: 5 N m hold it; 3 leave 1.905 for I = 1/4 + I_c."""
    rod = '<body><joint axis="0 1 0" frictionloss="{}"/><geom size=".05" pos=".5 0 0" mass="1"/></body>'
    model, data = compiled(rod.format(5))
    assert_stays(model, data, Moreau(0.5), 500)
    model, data = compiled(rod.format(3))
    h = model.opt.timestep
    stepping(model, Moreau(0.5)).step(data)
    inertia = 0.25 + 0.4 * 0.05**2
    assert data.qvel[0] == pytest.approx(h * (0.5 * G - 3) / inertia, rel=1e-9)
    model, data = compiled(rod.format(3), option='gravity="0 0 0"')
    data.qvel[0] = 4.0
    run(stepping(model, Moreau(0)), data, 25)
    assert data.qvel[0] == pytest.approx(4.0 - 3 / inertia * 25 * h, abs=1e-9)
    run(stepping(model, Moreau(0)), data, 200)
    assert abs(data.qvel[0]) < 1e-12


def test_dry_friction_of_tendons_holds():
    world = '<body><joint name="slide" type="slide" axis="0 0 1"/><geom size=".05" mass="1"/></body>'
    tendon = '<tendon><fixed frictionloss="10"><joint joint="slide" coef="1"/></fixed></tendon>'
    model, data = compiled(world, tendon)
    assert_stays(model, data, Moreau(0.5), 200)


@pytest.mark.parametrize("overlap", [1e-6, 1e-3, 0.03])
def test_an_overlap_of_the_start_opens_without_adding_velocity(overlap):
    model, data = compiled(FLOOR + box(z=0.125 - overlap))
    stepper = stepping(model, Newton(0.5))
    depths = []
    for _ in range(400):
        stepper.step(data)
        assert 0.5 * data.qvel @ data.qvel < 1e-12
        depths.append(0.125 - data.qpos[2])
    assert depths[-1] <= 1e-7
    assert (np.diff(depths) <= 1e-12).all()
    assert np.searchsorted(-np.array(depths), -1e-7) * model.opt.timestep <= overlap / 0.2 + 2 * model.opt.timestep


def test_a_jammed_wedge_stays_jammed():
    """A ball between two walls at 10 degrees is held by friction of 0.3, whatever its weight."""
    a = math.radians(5)
    walls = "".join(
        f'<geom type="plane" size="9 9 1" zaxis="{side * math.cos(a)} 0 {math.sin(a)}"/>' for side in (-1, 1)
    )
    ball = f'<body pos="0 0 {0.1 / math.sin(a)}"><freejoint/><geom size=".1" mass="5"/></body>'
    model, data = compiled(walls + ball, geom='friction=".3"')
    assert_stays(model, data, Moreau(0.5), 200)
