"""Events of collisions that have a solution in the step, with its forces and drifting constraints, but not alone."""

import mujoco
import numpy as np
import pytest
from scenes import compiled as scene
from stepping.test_tied_contacts import FIVE_BARS

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping import events

POLE = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="9 9 1"/>
  <body pos="0 0 .499"><joint name="hinge" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.48" size=".02" mass="1"/></body></worldbody>
  <actuator><motor joint="hinge"/></actuator></mujoco>"""
# positions and velocities of the five bars, which touch each other
JAMMED = [
    "0 0 .2511 .8997 .0647 .4208 -.0962 .5063 -1.4812 .7414 .095"
    " -.1188 -.249 .7097 -1.5096 3.8155 -1.5079 .1534 1.0831 6.0933 .7697",
    "0 0 .2465 .727 .0544 .4824 -.4855 -.9415 -.9452 .149 -.4323"
    " .0588 .6431 .1834 -1.1779 3.3984 -4.1312 -1.6944 2.4371 -.183 6.0067",
]
BAR = '<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 {0}" size=".02" mass=".2"/>'
FOUR_BARS = f"""<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="9 9 1"/>
  <site name="a" pos=".3 0 .5"/><body pos="0 0 .5">{BAR.format("0 0 -.3")}
    <body pos="0 0 -.3">{BAR.format(".3 0 0")}
      <body pos=".3 0 0">{BAR.format("0 0 .3")}<site name="b" pos="0 0 .3"/></body></body></body></worldbody>
  <equality><connect site1="a" site2="b"/><connect site1="b" site2="a"/></equality></mujoco>"""


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_pole_that_jams_but_for_its_motor_is_not_told_with_what_the_motor_does(compiled):
    """It cannot bounce by itself: friction 1 at its lower end outweighs the force along its short lever."""
    model = mujoco.MjModel.from_xml_string(POLE)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping", compiled=compiled)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.063, -1.0, 200.0
    stepper.step(data)
    assert data.qvel[0] > 3.0
    (event,) = stepper.events
    assert event.projected
    np.testing.assert_allclose(event.impact.post_velocity, 0.0, atol=1e-9)
    assert event.impact.energy_change == pytest.approx(-event.impact.collision.kinetic_energy)
    assert stepper.sums.energy_change == pytest.approx(event.impact.energy_change)


@pytest.mark.parametrize("state", JAMMED)
def test_the_contacts_of_an_event_create_no_energy(state):
    model = mujoco.MjModel.from_xml_string(FIVE_BARS)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.qpos[:], data.qvel[:] = np.split(np.array(state.split(), float), [model.nq])
    mujoco.mj_forward(model, data)
    stepper.step(data)
    works = [event.impact.energy_change - event.impact.surface_work for event in stepper.events]
    assert len(works) > 0
    assert max(works) < 0.0
    assert stepper.sums.energy_change == pytest.approx(sum(event.impact.energy_change for event in stepper.events))


@pytest.mark.parametrize(
    ("angles", "speeds"),
    [((-1.86, -0.175, -0.997), (-4.394, -3.266, -1.898)), ((0.287, 1.058, -0.011), (6.251, 8.414, 6.901))],
)
def test_events_of_a_planar_linkage_that_is_open_can_be_read(angles, speeds):
    """Nothing moves along one row of each of its connects, that across its plane: an island without joints."""
    model = mujoco.MjModel.from_xml_string(FOUR_BARS)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.qpos[:], data.qvel[:] = angles, speeds
    mujoco.mj_forward(model, data)
    stepper.step(data)
    assert [event.impact.energy_change < 0.0 for event in stepper.events] == [True]


STIFF = 'solimp=".9999 .9999 .001"'
# slides: range, the hinge that drives it, ratio, stiffness; then mass of each, position, velocity, control
ALL_BUT_FIXED = {
    "impulses of 2e11 N s": (
        [("1.051e-4 1.146e-4", "hip", -4.232e-4, ""), ("-2.84e-6 2.84e-6", "hip", -6.072e-4, "")],
        5.3e-3,
        [4.064e-4, -0.2642, 1.051e-4, 0.0],
        [0.186, -1.8, 0.0, 1.14e-3],
        [-1.04, 0.723],
    ),
    "SolverError": (
        [("-2.769e-7 2.769e-7", "hip", 3.436e-5, STIFF), ("2.683e-5 3.017e-5", "hip", -2.118e-4, STIFF),
         ("-7.48e-5 -1.942e-6", "knee", 2.09e-4, STIFF), ("-3.933e-5 -3.9e-5", "hip", 9.393e-5, "")],
        1.7e-3,
        [2.872e-4, -0.02867, -8.266e-8, 2.683e-5, -7.832e-6, -3.917e-5],
        [-0.234, 0.324, -2.79e-5, 0.0, 1.05e-4, -6.6e-5],
        [-0.458, 0.898],
    ),
}  # fmt: skip


def driven_slides(slides, mass):
    """Return a double pendulum with light slides on its lower link, which one of its hinges drives."""
    bar = '<joint name="{}" axis="0 1 0" {}/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".03" mass="{}"/>'
    bodies = ties = ""
    for i, (reach, hinge, ratio, solimp) in enumerate(slides):
        slide = f'<joint name="{i}" type="slide" axis="1 0 0" limited="true" range="{reach}"/>'
        bodies += f'<body>{slide}<geom size=".01" mass="{mass}"/></body>'
        ties += f'<joint joint1="{i}" joint2="{hinge}" polycoef="0 {ratio} 0 0 0" {solimp}/>'
    hip, knee = bar.format("hip", 'limited="true" range="-.05 .05"', 3), bar.format("knee", "", 2)
    motors = '<motor joint="hip" gear="60"/><motor joint="knee" gear="30"/>'
    return scene(
        f'<body>{hip}<body pos="0 0 -.5">{knee}{bodies}</body></body>',
        f"<equality>{ties}</equality><actuator>{motors}</actuator>",
        option='timestep=".005"',
        geom='contype="0" conaffinity="0"',
    )


@pytest.mark.parametrize("name", ALL_BUT_FIXED)
def test_limits_that_constraints_all_but_fix_have_impulses_of_the_size_of_the_momentum(name):
    """Several limits hold one hinge from both sides, by slides that it moves by some 1e-4 m per radian."""
    slides, mass, *state = ALL_BUT_FIXED[name]
    model, data = driven_slides(slides, mass)
    data.qpos[:], data.qvel[:], data.ctrl[:] = state
    mujoco.mj_forward(model, data)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    stepper.step(data)
    sums, (event,) = stepper.sums, stepper.events
    impact = event.impact
    speed = impact.collision.pre_speed
    assert np.abs(impact.impulse * impact.collision.gradient_norms).max() < 10.0 * speed
    assert abs(impact.surface_work) < 10.0 * speed**2
    assert sums.surface_work == impact.surface_work


def silo():
    """Return model and data of 120 balls above a funnel, between two walls that are a little more than a ball apart."""
    random, r, world = np.random.default_rng(0), 0.02, '<geom type="plane" size="9 9 1" pos="0 0 -.6"/>'
    for side in (-1, 1):
        world += f"""<geom type="box" size=".01 .05 .4" pos="{side * 0.15} 0 .5"/>
          <geom type="box" size=".01 .05 .1" pos="{side * 0.0995} 0 .05" euler="0 {side * 45} 0"/>"""
    for side in (-1, 1):
        world += f'<geom type="box" size=".3 .01 .9" pos="0 {side * 0.031} .3"/>'
    for k in range(120):
        x, z = (k % 6 - 2.5) * 2.1 * r + random.uniform(-5e-4, 5e-4), 0.18 + k // 6 * 2.1 * r
        world += f'<body pos="{x} 0 {z}"><freejoint/><geom size="{r}" mass=".03"/></body>'
    return scene(world, option='timestep="2e-3"', geom='friction=".5 1e-3 1e-4"')


def test_the_search_for_the_impulses_of_balls_that_jam_is_limited(monkeypatch):
    """Without limits the solver took 5 111 steps for one of these collisions, 37 s."""
    (model, data), limits, solve_cones = silo(), [], events.solve_cones
    stepper = Stepper(model, Moreau(0.3), scheme="time-stepping")

    def limited(*args, rounds=24, most=np.inf):
        limits.append((rounds, most))
        return solve_cones(*args, rounds=rounds, most=most)

    monkeypatch.setattr(events, "solve_cones", limited)
    for _ in range(150):
        stepper.step(data)
    (event,) = stepper.events
    assert len(event.contacts) > 100
    assert not event.projected
    assert np.all(np.array(limits) <= (4, 500))
