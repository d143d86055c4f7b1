"""Held contact with a mass matrix that depends on the configuration: energy, order, and sudden changes of force."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from impactlaw import MaximalDissipation, Moreau, Stepper

NOT = 'contype="0" conaffinity="0"'
PLANE = '<geom type="plane" size="3 3 .1" friction=".3"/>'
PENDULUM = f"""<body><joint axis="0 1 0" stiffness="3"/>
  <geom {NOT} type="capsule" fromto="0 0 0 .02 0 .15" size=".01" mass=".3"/></body>"""
SPHERE = f"""{PLANE}<body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="2"/>
  <body pos="0 0 .2"><joint axis="0 1 0" stiffness="20"/>
  <geom {NOT} type="capsule" fromto="0 0 0 0 0 .3" size=".01" mass=".2"/></body></body>"""
ARM = f"""{PLANE}<body pos="0 0 .5"><joint axis="0 1 0" damping=".2"/>
  <geom {NOT} type="capsule" fromto="0 0 0 .4 0 -.2" size=".02" mass="1"/>
  <body pos=".4 0 -.2"><joint axis="0 1 0" damping=".1"/>
  <geom {NOT} type="capsule" fromto="0 0 0 .3 0 -.29" size=".02" mass=".5"/>
  <geom pos=".3 0 -.29" size=".01" mass=".1" friction=".1"/></body></body>"""
ROLLING = f'<body pos="0 0 .1"><freejoint/><geom size=".1" mass="1" friction="1"/>{PENDULUM}</body>'
RIM = f"""{PLANE}<body pos="0 0 {0.1 * np.sin(0.3) + 0.02 * np.cos(0.3)}" quat="{np.cos(0.15)} {np.sin(0.15)} 0 0">
  <freejoint/><geom type="cylinder" size=".1 .02" mass="1"/></body>"""
LYING = """<body pos="0 0 .2"><freejoint/><geom type="cylinder" size=".2 .05" euler="90 0 0" mass="0" friction="2"/>
  <inertial pos="0 0 .1" mass="1" diaginertia=".03 .03 .03"/></body>"""
CORNERS = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
CUBE = f"""<body pos="0 0 .1"><freejoint/><geom type="mesh" mesh="cube" mass="1"/>{PENDULUM}</body></worldbody>
  <asset><mesh name="cube" vertex="{CORNERS}"/></asset><worldbody>"""
CURVED = '<geom size="1" pos="0 0 -1"/>'


def scene(bodies: str, timestep: float, integrator: str = "RK4") -> mujoco.MjModel:
    option = f'<option timestep="{timestep}" integrator="{integrator}"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{bodies}</worldbody></mujoco>")


def energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    scratch = mujoco.MjData(model)
    scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, scratch)
    mujoco.mj_energyPos(model, scratch)
    mujoco.mj_energyVel(model, scratch)
    return float(scratch.energy.sum())


def run(model: mujoco.MjModel, velocity: list[float], seconds: float, friction: str) -> tuple[np.ndarray, float]:
    """Return the final state, and the energy gained, J."""
    data = mujoco.MjData(model)
    data.qvel[:] = velocity
    before = energy(model, data)
    stepper = Stepper(model, MaximalDissipation(), friction=friction)  # pyright: ignore[reportArgumentType]
    for _ in range(round(seconds / model.opt.timestep)):
        stepper.step(data)
        assert not stepper.events
    return np.concatenate([data.qpos, data.qvel]), energy(model, data) - before


@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
@pytest.mark.parametrize(
    ("integrator", "timestep", "gained"),
    [("RK4", 4e-3, 3e-5), ("RK4", 2e-3, 3e-5), ("RK4", 1e-3, 1e-5), ("Euler", 2e-3, 1.6e-3), ("Euler", 4e-3, 6e-3)],
)
def test_a_sphere_at_rest_that_carries_a_pendulum_keeps_its_energy(integrator, timestep, gained, friction):
    _, change = run(scene(SPHERE, timestep, integrator), [0, 5], 1.0, friction)
    assert abs(change) <= gained


@pytest.mark.parametrize(
    ("bodies", "velocity", "friction"),
    [
        pytest.param(CURVED + ROLLING, [0.3, 0, 0, 0, 0, 0, 3], "ignore", id="slides over a sphere"),
        pytest.param(PLANE + ROLLING, [0.5, 0, 0, 0, 5, 0, 6], "coulomb", id="rolls on a plane"),
        pytest.param(CURVED + ROLLING, [0.3, 0.1, 0, -1, 3, 0, 6], "coulomb", id="rolls on a sphere"),
        pytest.param(PLANE + LYING, [0.6, 0, 0, 0, 3, 0], "coulomb", id="cylinder rolls on a plane"),
        pytest.param(PLANE + LYING, [0.6, 0, 0, 0, 3, 0], "ignore", id="cylinder slides on a plane"),
        pytest.param(PLANE + CUBE, [0.3, 0, 0, 0, 0, 0, 3], "ignore", id="mesh slides on a plane"),
        pytest.param(ARM, [0, 0], "ignore", id="damped arm slides"),
        pytest.param(ARM, [0, 0], "coulomb", id="damped arm slides with friction"),
    ],
)
def test_held_contact_is_of_second_order(bodies, velocity, friction):
    ends = [run(scene(bodies, h), velocity, 0.3, friction)[0] for h in (2e-3, 1e-3, 5e-4)]
    coarse, fine = (np.abs(a - b).max() for a, b in pairwise(ends))
    assert np.log2(coarse / fine) > 1.8


def test_a_disk_that_spins_on_a_rim_without_friction_keeps_its_energy():
    # a step in which its contact moves along the rim faster than the disk would lose some energy: 0.01 J in all without
    # the force of the previous step
    _, change = run(scene(RIM, 1e-3), [0, 0, 0, 0, 0, 20], 0.2, "ignore")
    assert abs(change) < 2e-4


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
def test_a_force_that_ends_leaves_nothing_behind(integrator, friction):
    # pressed down with 1 kN; the contact force of the previous step would throw it up
    model = scene(PLANE + '<body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/></body>', 1e-2, integrator)
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation(), friction=friction)  # pyright: ignore[reportArgumentType]
    for push in [-1e3] * 3 + [0.0] * 3 + [-1e3, 12.0, 12.0]:
        data.qfrc_applied[2] = push
        stepper.step(data)
        if push <= 0:
            assert abs(data.qpos[2] - 0.1) < 1e-9
            assert abs(data.qvel[2]) < 1e-9
    assert data.qvel[2] == pytest.approx((12 - 9.81) * 2e-2, abs=1e-9)
    assert data.qfrc_applied[2] == 12.0


KNOB = """<body pos="0 0 1"><joint name="knob" axis="0 1 0" damping="2" armature=".001"/>
    <inertial pos="0 0 0" mass=".01" diaginertia="1e-5 1e-5 1e-5"/></body>
  <body pos="1 0 1"><joint name="lid" type="slide" axis="0 0 1" damping="2" armature=".001" range="0 1" limited="true"/>
    <inertial pos="0 0 0" mass=".01" diaginertia="1e-5 1e-5 1e-5"/></body>"""


@pytest.mark.parametrize("start", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("integrator", "timestep", "speed", "play"),
    [("Euler", 2e-3, 0.03, 1e-3), ("implicitfast", 1e-2, 0.1, 3e-3), ("RK4", 5e-4, 0.03, 1e-3)],
)
@pytest.mark.parametrize("joints", [("knob", "lid"), ("lid", "knob")])
def test_a_joint_equality_beside_a_limit_that_is_held_stays_there(integrator, timestep, speed, play, joints, start):
    """The soft equality leaves some play; if the held contact passed its error on, the joints would diverge at once."""
    equality = '<equality><joint joint1="{}" joint2="{}" polycoef="0 10 0 0 0"/></equality>'.format(*joints)
    option = f'<option timestep="{timestep}" integrator="{integrator}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{KNOB}</worldbody>{equality}</mujoco>")
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation())
    data.joint("knob").qpos[0] = start
    for _ in range(500):
        stepper.step(data)
        assert np.abs(data.qvel).max() < speed
        assert np.abs(data.qpos).max() < play


WRIST = """<body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
  <geom {NOT} size=".02" mass="2"/><body><joint axis="0 1 0" damping="1"/>
  <geom size=".02" pos=".1 0 -.08" mass=".01" friction=".1"/></body></body>"""


@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_joint_with_more_damping_than_inertia_gives_way_as_fast_as_its_damping_lets_it(integrator, friction):
    """A mass sinks onto the floor over a light wrist whose ``h D`` is 15 times its inertia."""
    bodies = f'<geom type="plane" size="3 3 .1" friction=".1"/>{WRIST.format(NOT=NOT)}'
    exact, _ = run(scene(bodies, 1e-4), [0.0] * 3, 0.1, friction)
    model = scene(bodies, 2.5e-3, integrator)
    assert model.opt.timestep * model.dof_damping[2] > 15 * model.dof_M0[2]
    end, _ = run(model, [0.0] * 3, 0.1, friction)
    np.testing.assert_allclose(end, exact, rtol=0.03, atol=1e-4)


@pytest.mark.parametrize("inertia", [1e-4, 1e-6])
def test_a_point_mass_on_a_light_leg_turns_about_its_foot(inertia):
    """It moves as an inverted pendulum: w^2 / 2 + g cos(angle) / l is constant, and the foot stays on the ground."""
    model = scene(
        f"""<geom type="plane" size="9 9 1" friction="5"/><body pos="0 0 1"><joint type="slide" axis="1 0 0"/>
        <joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>
        <geom size=".001" pos="0 0 -.999" friction="5"/></body>""",
        0.002,
    )
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation())
    data.qpos[:] = 0.999 * np.sin(-0.3), 0.999 * (np.cos(-0.3) - 1), -0.3
    data.qvel[:] = 1.2 * (0.999 * np.cos(-0.3) + 0.001), 1.2 * 0.999 * np.sin(0.3), 1.2
    before = 1.2**2 / 2 + 9.81 * np.cos(-0.3)
    for _ in range(150):
        stepper.step(data)
        assert stepper.events == ()
    assert data.qvel[2] ** 2 / 2 + 9.81 * np.cos(data.qpos[2]) == pytest.approx(before, abs=5e-3)
    assert data.qpos[1] + 1 - 0.999 * np.cos(data.qpos[2]) == pytest.approx(0.001, abs=2e-9)


@pytest.mark.parametrize(("mass", "timestep"), [(1e-3, 0.01), (1e-3, 0.005), (1e-6, 0.01)])
def test_a_light_foot_stays_where_it_sticks_while_its_leg_turns_over_it(mass, timestep):
    """A foot of 10 um rolls by 6 um; near the upright position, its gap closes with least cost by sliding far aside."""
    model = scene(
        f"""<geom type="plane" size="9 9 1" friction="1"/><body pos="0 0 1.00001"><joint type="slide" axis="1 0 0"/>
        <joint type="slide" axis="0 0 1"/><geom {NOT} size=".05" mass="1"/>
        <body><joint axis="0 1 0"/><inertial pos="0 0 -1" mass="{mass}" diaginertia="{mass} {mass} {mass}"/>
        <geom name="foot" size=".00001" pos="0 0 -1" friction="1"/></body></body>""",
        timestep,
    )
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation())
    data.qpos[:] = np.sin(-0.3), np.cos(0.3) - 1, -0.3
    data.qvel[:] = 1.2 * np.cos(0.3), 1.2 * np.sin(0.3), 1.2
    for _ in range(round(0.6 / timestep)):
        stepper.step(data)
        assert abs(data.geom("foot").xpos[0]) < 5e-5
    assert data.qpos[2] > 0.2


CAN = (
    """{plane}<body pos="0 0 .2" quat="{c} {s} 0 0"><freejoint/><geom type="cylinder" size=".1 .05" mass="1"/></body>"""
)


@pytest.mark.parametrize("friction", ["coulomb", "ignore"])
@pytest.mark.parametrize(
    ("timestep", "tilt", "e"),
    [(4e-3, 0.5, 0.0), (4e-3, 0.3, 0.0), (2e-3, 0.8, 0.3), (1e-3, 0.3, 0.3), (5e-4, 0.1, 0.3)],
)
def test_a_can_comes_to_rest_on_its_face_and_draws_no_energy_from_it(timestep, tilt, e, friction):
    model = scene(CAN.format(plane=PLANE, c=np.cos(tilt / 2), s=np.sin(tilt / 2)), timestep)
    data = mujoco.MjData(model)
    stepper, before = Stepper(model, Moreau(e), friction=friction), energy(model, data)
    taken, collisions = 0.0, 0
    for _ in range(round(0.72 / timestep)):
        stepper.step(data)
        taken -= sum(event.impact.energy_change for event in stepper.events)
        collisions += len(stepper.events)
    assert energy(model, data) + taken - before <= 3e-4  # of 1.5 J
    assert collisions <= 80
    assert np.abs(data.qvel[2:]).max() <= 1e-6


@pytest.mark.parametrize(
    "velocity",
    [(0.06, -0.07, 0.3, 0.05, -0.3, 0.2, 0.6), (0.0629, -0.0661, 0.3202, 0.0525, -0.2678, 0.1808, 0.652)],
)
def test_a_heavy_arm_is_not_thrown_by_the_forces_that_hold_the_light_ball_below_it(velocity):
    """The ball has a millionth of the mass of the arm: within a step these forces alone would turn it by 1 rad."""
    arm = """<body pos="0 0 .5"><freejoint/><geom size=".1" mass=".001"/>
      <body pos=".3 0 0"><joint axis="0 1 0" range="-10 10" limited="true"/><geom pos=".2 0 0" size=".1" mass="1000"/>
      </body></body>"""
    model = scene(PLANE.replace(' friction=".3"', "") + arm, 2e-3)
    data = mujoco.MjData(model)
    data.qvel[:] = velocity
    stepper, begun = Stepper(model, MaximalDissipation()), energy(model, data)
    for _ in range(250):
        stepper.step(data)
        assert energy(model, data) <= 1.001 * begun
