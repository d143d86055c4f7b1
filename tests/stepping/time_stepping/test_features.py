"""All that a scene can have beside geoms and joints: equality, surfaces, adhesion, actuators, sensors, shapes."""

import math

import mujoco
import numpy as np
import pytest
from scenes import compiled, run

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper

G = 9.81
FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'


def stepping(model, law, **options):
    return Stepper(model, law, scheme="time-stepping", **options)


def first_impact(stepper, data, most=2000):
    for _ in range(most):
        before = data.qvel.copy()
        stepper.step(data)
        if stepper.events:
            (event,) = stepper.events
            return before, event
    raise AssertionError("nothing collided")


# --- equality constraints --------------------------------------------------------------------------------------------

MASSES = """<body pos="0 0 1.1"><joint name="down" type="slide" axis="0 0 1"/>
    <geom name="heavy" size=".1" mass="3"/></body>
    <body pos="1 0 3"><joint name="up" type="slide" axis="0 0 1"/><geom name="light" size=".1" mass="1"/></body>"""


@pytest.mark.parametrize("how", ["joint", "tendon"])
@pytest.mark.parametrize("timestep", [2e-3, 5e-4])
def test_two_masses_on_a_rope_hit_the_floor_together(how, timestep):
    """After 1 m with g / 2 all 4 kg stop and go back: Lambda = 4 (1 + e) u, u = sqrt(g)."""
    rest = '<equality><joint joint1="up" joint2="down" polycoef="0 -1 0 0 0"/></equality>'
    if how == "tendon":
        both = '<joint joint="down" coef="1"/><joint joint="up" coef="1"/>'
        rest = f'<tendon><fixed name="rope">{both}</fixed></tendon><equality><tendon tendon1="rope"/></equality>'
    model, data = compiled(FLOOR + MASSES, rest, option=f'timestep="{timestep}"', geom='friction=".3"')
    before, event = first_impact(stepping(model, Newton(0.5)), data)
    u = math.sqrt(G)
    assert before == pytest.approx([-u, u], abs=G * timestep)  # two steps of g / 2
    assert event.impact.impulse == pytest.approx([4 * 1.5 * -before[0]], rel=1e-5)
    assert event.impact.impulse == pytest.approx([18.79], abs=6 * G * timestep)
    assert event.impact.post_velocity == pytest.approx([1.566, -1.566], abs=0.5 * G * timestep)
    assert data.qvel[0] == pytest.approx(-0.5 * before[0], abs=1e-9)
    assert data.qvel[1] == pytest.approx(-data.qvel[0], abs=5e-3)  # MuJoCo's rope gives a little between collisions


def test_a_connect_makes_a_pendulum_of_a_free_body():
    world = '<body name="bob" pos="1 0 0"><freejoint/><geom size=".05" mass="1"/></body>'
    model, data = compiled(world, '<equality><connect body1="bob" body2="world" anchor="-1 0 0"/></equality>')
    stepper = stepping(model, Moreau(0.5))
    for _ in range(300):
        stepper.step(data)
        rotated = np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, np.array([-1.0, 0, 0]), data.qpos[3:7])
        assert np.linalg.norm(data.qpos[:3] + rotated) < 2e-3
    reference = compiled('<body><joint axis="0 1 0"/><geom size=".05" pos="1 0 0" mass="1"/></body>')
    run(stepping(reference[0], Moreau(0.5)), reference[1], 300)
    angle = reference[1].qpos[0]
    assert data.qpos[[0, 2]] == pytest.approx([math.cos(angle), -math.sin(angle)], abs=5e-3)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_two_welded_boxes_bounce_as_one(e):
    bodies = "".join(
        f'<body name="{n}" pos="0 0 {z}"><freejoint/><geom name="{n}" type="box" size=".1 .1 .1" mass="{m}"/></body>'
        for n, z, m in (("low", 0.3, 1), ("high", 0.52, 3))
    )
    weld = '<equality><weld body1="low" body2="high"/></equality><contact><exclude body1="low" body2="high"/></contact>'
    model, data = compiled(FLOOR + bodies, weld)
    before, event = first_impact(stepping(model, Newton(e)), data)
    u = -before[2]
    assert data.qvel[2] == pytest.approx(e * u, abs=1e-9)
    assert data.qvel[8] == pytest.approx(e * u, abs=2e-2 * u)
    assert event.impact.impulse.sum() == pytest.approx(4 * (1 + e) * u, rel=2e-2)


def test_equality_constraints_that_are_off_hold_nothing():
    rest = '<equality><joint joint1="up" joint2="down" polycoef="0 -1 0 0 0"/></equality>'
    model, data = compiled(FLOOR + MASSES, rest)
    data.eq_active[0] = 0
    run(stepping(model, Newton(0.5)), data, 50)
    assert data.qvel == pytest.approx([-0.981, -0.981], abs=1e-9)
    data.eq_active[0] = 1
    run(stepping(model, Newton(0.5)), data, 200)
    assert data.qvel[0] == pytest.approx(-data.qvel[1], abs=0.05)


# --- moving surfaces -------------------------------------------------------------------------------------------------

TABLE = '<body name="table" mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/></body>'


def falling(z=1.1):
    return f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="1"/></body>'


def drive(stepper, data, path, steps):
    events = []
    for _ in range(steps):
        data.mocap_pos[0, 2] = path(data.time + stepper.model.opt.timestep)
        stepper.step(data)
        events += stepper.events
    return events


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_table_that_rises_adds_its_speed(e):
    """v+ = -e v- + (1 + e) w."""
    model, data = compiled(TABLE + falling(), geom='condim="1"')
    stepper = stepping(model, Newton(e))
    data.mocap_pos[0] = 0
    stepper.step(data)
    events, w = [], 0.8
    while not events:
        before = data.qvel[0]
        events = drive(stepper, data, lambda t: w * (t - 0.002), 1)
        assert data.time < 2
    assert data.qvel[0] == pytest.approx(-e * before + (1 + e) * w, abs=1e-9)
    assert events[0].impact.surface_work == pytest.approx(events[0].impact.impulse[0] * w, rel=1e-9)


def test_a_ball_rides_on_a_table():
    model, data = compiled(TABLE + falling(0.1), option='timestep="0.005"', geom='condim="1"')
    stepper = stepping(model, Newton(0.8))
    for _ in range(300):
        events = drive(stepper, data, lambda t: 0.05 * (1 - math.cos(10 * t)), 1)
        assert events == []
        assert data.qpos[0] == pytest.approx(data.mocap_pos[0, 2], abs=2e-4)  # the table turns round within a step


def test_a_fast_table_hits_what_it_would_pass_through():
    """Nothing but the table moves: 50 m/s, 10 cm a step, against a ball of 2 cm at rest."""
    ball = '<body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom size=".01" mass="1"/></body>'
    thin = '<body name="table" mocap="true"><geom type="box" size="1 1 .001"/></body>'
    model, data = compiled(thin + ball, option='gravity="0 0 0" timestep="2e-3"', geom='condim="1"')
    stepper = stepping(model, Newton(0.5))
    stepper.step(data)
    events = drive(stepper, data, lambda t: 50 * (t - 0.002), 30)
    assert len(events) >= 1
    assert data.qvel[0] == pytest.approx(75, abs=1e-6)
    assert data.qpos[0] + 1 > data.mocap_pos[0, 2]


def test_a_mocap_gripper_that_closes_on_a_box_is_no_error_and_does_not_throw_it():
    world = "".join(
        f'<body name="{n}" mocap="true" pos="{x} 0 .1"><geom type="box" size=".02 .1 .1"/></body>'
        for n, x in (("left", -0.12), ("right", 0.12))
    )
    world += '<body name="b" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>' + FLOOR
    model, data = compiled(world, geom='friction="1"')
    stepper = stepping(model, Moreau(0))
    stepper.step(data)
    for _ in range(100):
        data.mocap_pos[:, 0] += [5e-6, -5e-6]
        stepper.step(data)
        assert data.qpos[:3] == pytest.approx([0, 0, 0.1], abs=5e-4)  # somewhere between the two
        assert np.linalg.norm(data.qvel[:3]) < math.sqrt(2 * G * 5e-4)  # a fall of as much as it is squeezed


@pytest.mark.parametrize("condim", [3, 4])
def test_a_belt_drags_a_box_to_its_own_speed(condim):
    belt = '<geom name="belt" type="box" size="9 1 .1" pos="0 0 -.1" surfacevel="1.5 0 0 0 0 0"/>'
    box = '<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body>'
    model, data = compiled(belt + box, geom=f'friction=".3" condim="{condim}"')
    stepper = stepping(model, Newton(0.5))
    duration = 1.5 / (0.3 * G)
    while data.time < 0.4 - 1e-9:
        stepper.step(data)
        assert data.qvel[0] == pytest.approx(0.3 * G * data.time, abs=1e-8)
    while data.time < 2 * duration:
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(1.5, abs=1e-9)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)


# --- adhesion --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("force", "holds"), [(30.0, True), (15.0, False)])
def test_an_adhesion_actuator_holds_a_box_on_a_ceiling(force, holds):
    world = """<geom type="box" size="1 1 .1" pos="0 0 .1"/>
        <body name="b" pos="0 0 -.1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body>"""
    model, data = compiled(world, f'<actuator><adhesion body="b" ctrlrange="0 1" gain="{force}"/></actuator>')
    data.ctrl[0] = 1.0
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 300)
    if holds:
        assert data.qpos[2] == pytest.approx(-0.1, abs=1e-6)
        assert abs(data.qvel).max() < 1e-6
    else:
        assert data.qpos[2] < -0.2


@pytest.mark.parametrize("away", [0.0, 0.002, 0.005])
def test_adhesion_of_geoms_holds_and_pulls_within_its_range(away):
    """Four contacts of 30 N against 19.6 N, in touch and across the range of 1 cm."""
    world = f"""<geom type="box" size="1 1 .1" pos="0 0 .1"/><body pos="0 0 {-0.1 - away}"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="2" adhesion="30" gap=".01"/></body>"""
    model, data = compiled(world)
    run(stepping(model, Moreau(0)), data, 300)
    assert data.qpos[2] == pytest.approx(-0.1, abs=1e-6)


def test_adhesion_presses_a_box_to_a_wall_by_friction():
    world = """<geom type="box" size=".1 1 1" pos="-.2 0 0"/>
        <body name="b"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>"""
    model, data = compiled(
        world, '<actuator><adhesion body="b" ctrlrange="0 1" gain="30"/></actuator>', geom='friction=".5"'
    )
    data.ctrl[0] = 1.0
    run(stepping(model, Moreau(0)), data, 300)
    assert data.qpos[:3] == pytest.approx([0, 0, 0], abs=1e-6)


# --- shapes ----------------------------------------------------------------------------------------------------------


def dropped(world, rest="", seconds=1.0, **options):
    model, data = compiled(world, rest, **options)
    stepper = stepping(model, Moreau(0.0))
    run(stepper, data, round(seconds / model.opt.timestep))
    return model, data, stepper


CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))


def test_a_mesh_falls_on_a_mesh_and_rests():
    rest = f'<asset><mesh name="cube" vertex="{CUBE}"/></asset>'
    world = '<geom type="mesh" mesh="cube"/><body pos="0 0 .23"><freejoint/><geom type="mesh" mesh="cube"/></body>'
    _, data, _ = dropped(world, rest)
    assert data.qpos[2] == pytest.approx(0.2, abs=1e-6)
    assert abs(data.qvel).max() < 1e-6


def test_a_ball_and_a_box_rest_on_a_height_field():
    rest = '<asset><hfield name="flat" nrow="20" ncol="20" size="2 2 .5 .1"/></asset>'
    world = """<geom type="hfield" hfield="flat"/><body pos="0.03 0.02 .13"><freejoint/><geom size=".1"/></body>
        <body pos="0.61 0.53 .13"><freejoint/><geom type="box" size=".1 .1 .1"/></body>"""
    _, data, _ = dropped(world, rest)
    assert data.qpos[[2, 9]] == pytest.approx([0.1, 0.1], abs=1e-5)
    assert abs(data.qvel).max() < 1e-3


@pytest.mark.parametrize("shape", ['type="ellipsoid" size=".2 .15 .1"', 'type="cylinder" size=".15 .1"',
                                   'type="capsule" size=".1 .2" euler="90 0 0"'])  # fmt: skip
def test_round_shapes_fall_and_rest(shape):
    _, data, _ = dropped(FLOOR + f'<body pos="0 0 .13"><freejoint/><geom {shape}/></body>')
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-6)
    assert abs(data.qvel).max() < 1e-3


def test_a_cylinder_rolls_as_far_as_it_should():
    """Solid, a = 2/3 g sin(angle) where it sticks."""
    angle = 0.2
    world = FLOOR + '<body pos="0 0 .1" euler="90 0 0"><freejoint/><geom type="cylinder" size=".1 .3" mass="1"/></body>'
    option = f'gravity="{G * math.sin(angle)} 0 {-G * math.cos(angle)}" timestep="1e-3"'
    _, data, _ = dropped(world, option=option, geom='condim="3" friction="1"')
    assert data.qvel[0] == pytest.approx(2 / 3 * G * math.sin(angle), rel=1e-3)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("law", [MaximalDissipation(), Newton(0.5)])
@pytest.mark.parametrize("speed", [10.0, 100.0, 300.0])
def test_a_fast_ball_does_not_pass_through_a_thin_plate(law, speed):
    world = """<geom name="plate" type="box" size=".0005 1 1"/>
        <body pos="-1.013 0 0"><freejoint/><geom size=".01" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[0] = speed
    stepper = stepping(model, law)
    events = run(stepper, data, round(1.5 / speed / 0.002) + 5)
    assert len(events) == 1
    assert data.qpos[0] < 0
    e = 0.5 if isinstance(law, Newton) else 0.0
    assert data.qvel[0] == pytest.approx(-e * speed, abs=1e-7)


def test_two_fast_balls_do_not_pass_through_each_other():
    world = "".join(f'<body pos="{x} 0 0"><freejoint/><geom size=".01" mass="1"/></body>' for x in (-1.003, 1.0))
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[[0, 6]] = 100.0, -100.0
    events = run(stepping(model, Newton(0.5)), data, 10)
    assert len(events) == 1
    assert data.qvel[[0, 6]] == pytest.approx([-50, 50], abs=1e-7)


def test_a_fast_rod_that_turns_does_not_pass_through_a_pin():
    world = """<geom type="capsule" fromto=".8 0 -1 .8 0 1" size=".005"/>
        <body euler="0 0 -60"><joint axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 1 0 0" size=".005" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[0] = 100.0
    (event,) = run(stepping(model, Newton(0.5)), data, 8)
    assert event.impact.post_velocity == pytest.approx([-50], abs=1e-6)
    assert data.qpos[0] < math.radians(60)


# --- actuators, damping, integration ---------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast"])
def test_stiff_joint_damping_is_stable(integrator):
    """h d / I = 500."""
    world = '<body><joint axis="0 1 0" damping="500"/><geom size=".05" pos=".5 0 0" mass=".008"/></body>'
    model, data = compiled(world, option=f'timestep="2e-3" integrator="{integrator}"')
    data.qvel[0] = 10.0
    stepper = stepping(model, Moreau(0.5))
    for _ in range(100):
        stepper.step(data)
        assert abs(data.qvel[0]) < 0.1
    assert data.qvel[0] == pytest.approx(0.5 * 0.008 * G * math.cos(data.qpos[0]) / 500, rel=1e-3)


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_a_stiff_velocity_servo_is_stable_under_the_implicit_integrators(integrator):
    world = '<body><joint name="j" axis="0 1 0"/><geom size=".05" pos=".5 0 0" mass=".008"/></body>'
    actuator = '<actuator><velocity joint="j" kv="500"/></actuator>'
    model, data = compiled(world, actuator, option=f'timestep="2e-3" integrator="{integrator}"')
    data.ctrl[0] = 3.0
    run(stepping(model, Moreau(0.5)), data, 100)
    assert data.qvel[0] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_position_actuators_of_a_million_press_a_slide_onto_its_limit(integrator):
    world = (
        '<body><joint name="j" type="slide" axis="1 0 0" range="0 1" damping="2000"/><geom size=".05" mass="1"/></body>'
    )
    actuator = '<actuator><position joint="j" kp="1e6"/></actuator>'
    model, data = compiled(world, actuator, option=f'timestep="1e-3" integrator="{integrator}"')
    data.ctrl[0] = 1.3
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 500)
    assert data.qpos[0] == pytest.approx(1.0, abs=1e-6)
    assert abs(data.qvel[0]) < 1e-6
    assert run(stepper, data, 100) == []


@pytest.mark.parametrize("kind", ["integrator", "filter", "filterexact", "muscle"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_activations_and_time_are_those_of_mujoco(kind, integrator):
    world = '<body><joint name="j" type="slide" axis="0 0 1"/><geom size=".05" mass="1"/></body>'
    if kind == "muscle":
        world = world.replace('axis="0 0 1"', 'axis="0 0 1" limited="false"')
        actuator = '<actuator><muscle joint="j" lengthrange="-1 1"/></actuator>'
    else:
        dynamics = f'dyntype="{kind}" dynprm=".05" actlimited="true" actrange="-2 .7"'
        actuator = f'<actuator><general joint="j" {dynamics}/></actuator>'
    model, data = compiled(world, actuator, option=f'integrator="{integrator}" gravity="0 0 0"')
    reference, stepper = mujoco.MjData(model), stepping(model, Moreau(0.5))
    for i in range(200):
        data.ctrl[0] = reference.ctrl[0] = math.sin(0.05 * i) * 3
        stepper.step(data)
        mujoco.mj_step(model, reference)
        if kind != "muscle":
            assert data.act == pytest.approx(reference.act, abs=1e-12)
        assert data.time == reference.time
    assert data.act == pytest.approx(reference.act, abs=1e-9)
    assert data.qpos == pytest.approx(reference.qpos, rel=0.05, abs=1e-4)


def test_applied_forces_and_controls_act():
    model, data = compiled('<body name="b"><freejoint/><geom size=".1" mass="2"/></body>', option='gravity="0 0 0"')
    data.xfrc_applied[1, :3] = 4, 0, 0
    data.qfrc_applied[1] = 6
    run(stepping(model, Moreau(0)), data, 50)
    assert data.qvel[:3] == pytest.approx([0.2, 0.3, 0], abs=1e-12)
    assert data.qpos[:2] == pytest.approx([0.5 * 2 * 0.01, 0.5 * 3 * 0.01], abs=1e-12)


def test_a_control_callback_is_called_once_a_step():
    model, data = compiled(FLOOR + falling(), "<actuator/>")
    calls = []
    mujoco.set_mjcb_control(lambda m, d: calls.append(d.time))
    try:
        run(stepping(model, Moreau(0)), data, 5)
    finally:
        mujoco.set_mjcb_control(None)
    assert calls == pytest.approx([0, 0.002, 0.004, 0.006, 0.008])


# --- sensors and forces ----------------------------------------------------------------------------------------------

SENSED = (
    FLOOR
    + """<body name="b" pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="3"/>
    <site name="s" type="box" size=".11 .11 .11"/></body>"""
)
SENSORS = """<sensor><touch site="s"/><accelerometer site="s"/><velocimeter site="s"/><gyro site="s"/>
    <framelinacc objtype="body" objname="b"/></sensor>"""


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_a_resting_box_feels_its_weight(cone, jacobian, condim):
    option = f'cone="{cone}" jacobian="{jacobian}"'
    model, data = compiled(SENSED, SENSORS, option=option, geom=f'condim="{condim}"')
    run(stepping(model, Moreau(0.5)), data, 5)
    touch, acceleration, velocity = data.sensordata[0], data.sensordata[1:4], data.sensordata[4:10]
    assert touch == pytest.approx(3 * G, rel=1e-8)
    assert acceleration == pytest.approx([0, 0, G], abs=1e-7)
    assert velocity == pytest.approx(np.zeros(6), abs=1e-9)
    mujoco.mj_rnePostConstraint(model, data)
    assert data.cfrc_ext[1, 3:] == pytest.approx([0, 0, 3 * G], abs=1e-6)
    assert data.qfrc_constraint[2] == pytest.approx(3 * G, rel=1e-8)
    forces = np.zeros((data.ncon, 6))
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, forces[i])
    assert forces[:, 0].sum() == pytest.approx(3 * G, rel=1e-8)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_a_box_that_slides_feels_friction(cone):
    model, data = compiled(SENSED, SENSORS, option=f'cone="{cone}"', geom='friction=".3"')
    data.qvel[0] = 5.0
    run(stepping(model, Moreau(0)), data, 20)
    assert data.sensordata[1:4] == pytest.approx([-0.3 * G, 0, G], abs=1e-6)
    assert data.sensordata[4] == pytest.approx(data.qvel[0], abs=0.3 * G * 0.002 + 1e-9)
    mujoco.mj_rnePostConstraint(model, data)
    assert data.cfrc_ext[1, 3:] == pytest.approx([-0.9 * G, 0, 3 * G], abs=1e-5)


def test_force_and_torque_sensors_of_a_held_arm():
    world = """<body name="base" pos="0 0 1"><body name="arm"><joint type="slide" axis="0 0 1" frictionloss="1e3"/>
        <geom size=".1" pos=".5 0 0" mass="2"/><site name="s"/></body></body>"""
    sensor = '<sensor><force site="s"/><torque site="s"/></sensor>'
    model, data = compiled(world, sensor)
    run(stepping(model, Moreau(0)), data, 3)
    assert data.sensordata[:3] == pytest.approx([0, 0, 2 * G], abs=1e-6)
    assert data.sensordata[4] == pytest.approx(-0.5 * 2 * G, abs=1e-6)


def test_limits_and_dry_friction_tell_their_forces():
    world = """<body><joint name="j" type="slide" axis="0 0 1" range="0 1"/><geom size=".1" mass="3"/></body>
        <body pos="2 0 0"><joint name="k" type="slide" axis="0 0 1" frictionloss="1e3"/>
        <geom size=".1" mass="3"/></body>"""
    model, data = compiled(world, '<sensor><jointlimitfrc joint="j"/></sensor>')
    run(stepping(model, Moreau(0)), data, 3)
    assert data.sensordata == pytest.approx([3 * G], rel=1e-8)
    assert data.qfrc_constraint == pytest.approx([3 * G, 3 * G], rel=1e-8)


def test_the_energy_flag_is_respected():
    model, data = compiled(FLOOR + falling(), geom='condim="1"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    stepper = stepping(model, Moreau(1))
    for _ in range(300):
        stepper.step(data)
        assert data.energy == pytest.approx([G * (data.qpos[0] + 1.1), 0.5 * data.qvel[0] ** 2], abs=1e-9)


def test_frames_are_current_after_a_step():
    model, data = compiled(FLOOR + falling() + '<body name="m" mocap="true" pos="3 0 0"/>')
    data.mocap_pos[0] = 3, 1, 2
    run(stepping(model, Moreau(1)), data, 30)
    assert data.body(1).xpos[2] == pytest.approx(data.qpos[0] + 1.1, abs=1e-12)
    assert data.body("m").xpos == pytest.approx([3, 1, 2], abs=1e-12)


def test_acceleration_is_the_change_of_velocity():
    model, data = compiled(FLOOR + falling(0.12), geom='condim="1"')
    stepper = stepping(model, Moreau(0.5))
    for _ in range(50):
        before = data.qvel.copy()
        stepper.step(data)
        assert data.qacc == pytest.approx((data.qvel - before) / model.opt.timestep, rel=1e-9, abs=1e-9)
