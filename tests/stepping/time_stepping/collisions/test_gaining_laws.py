"""Laws that would create energy are scaled in time stepping, unless an option says otherwise."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Fremond, LinearMap, Moreau, Newton, Stepper
from impactlaw.errors import InadmissibleImpactError


def kane(law, **options):
    """Let a sliding oblique rod hit the floor; return the energies before and after the impact, and the stepper."""
    world = (
        FLOOR
        + """<body pos="0 0 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia=".3333 .3333 .3333"/>
        <geom name="tip" size=".01" pos=".6 0 -.8" friction=".7"/></body>"""
    )
    model, data = compiled(world, option='gravity="0 0 0" timestep="1e-3"', geom='friction=".7"')
    data.qpos[1] = -0.19 + 5e-4
    data.qvel[:2] = -1.0, -1.0
    stepper = stepping(model, law, **options)
    before = 0.5 * data.qvel @ np.diag([1, 1, 0.3333]) @ data.qvel
    for _ in range(3):
        stepper.step(data)
        if stepper.events:
            return before, 0.5 * data.qvel @ np.diag([1, 1, 0.3333]) @ data.qvel, stepper
    raise AssertionError("nothing collided")


@pytest.mark.parametrize("e", [0.9, 1.0])
def test_kanes_oblique_rod_gains_nothing_by_default_and_does_where_it_is_allowed(e):
    before, after, _ = kane(Newton(e))
    assert after <= before * (1 + 1e-9)
    assert after > 0.95 * before
    before, after, _ = kane(Newton(e), on_inadmissible="allow")
    assert after > before * 1.001


def test_the_event_of_a_scaled_impact_shows_what_happened():
    before, after, stepper = kane(Newton(1.0))
    (event,) = stepper.events
    assert event.impact.energy_change == pytest.approx(after - before, abs=1e-6)
    assert event.impact.violations.is_admissible()


GAINING = {
    "linear map": LinearMap(np.diag([1.0, 1.0, -3.0])),
    "fremond": Fremond([[1.0, 1.5], [0.0, 1.0]]),
}


@pytest.mark.parametrize("law", GAINING.values(), ids=GAINING)
def test_a_law_that_creates_energy_is_held_back_let_through_or_refused(law):
    def struck(**options):
        model, data = compiled(
            "".join(
                f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'
                for x in (0, 0.2, 0.4)
            ),
            option='gravity="0 0 0" timestep="1e-3"',
            geom='condim="1"',
        )
        data.qvel[:] = (1.0, 0.0, -1.0)
        stepping(model, law, **options).step(data)
        return 0.5 * data.qvel @ data.qvel

    assert struck() <= 1.0 + 1e-9
    assert struck(on_inadmissible="project") <= 1.0 + 1e-9
    assert struck(on_inadmissible="allow") > 1.01
    with pytest.raises(InadmissibleImpactError):
        struck(on_inadmissible="raise")


FOLDED_LEG = """<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody>
  <body><freejoint/><inertial pos="0 0 0" mass="40" diaginertia="1.7 1.6 .34"/>
    <body pos=".33 -.07 0"><inertial pos="0 0 0" mass="2.5" diaginertia=".005 .004 .003"/>
      <joint axis="1 0 0" armature=".1"/>
      <geom type="{}" size=".06 .06 .03" pos="0 -.12 0" quat=".7071 .7071 0 0"/>
      <body pos="0 -.12 0"><inertial pos="0 .037 -.043" mass="7.5" diaginertia=".085 .084 .011"/>
        <joint axis="0 1 0" armature=".1"/>
        <body pos="0 0 -.35"><inertial pos=".01 0 -.16" mass=".68" diaginertia=".016 .016 .0004"/>
          <joint axis="0 1 0" range="-2.82 -.43" limited="true" armature=".1"/>
          <geom type="box" size=".05 .0122 .009" pos=".022 0 -.1" quat=".7807 0 .6249 0"/>
          <geom type="box" size=".075 .0122 .0075" pos=".036 0 -.225" quat=".7214 0 .6925 0"/>
          <geom size=".032" pos="0 0 -.35"/>
        </body></body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("hip", "angle", "speed"),
    [
        ("sphere", (0.07, 3.12, -2.78), (8.0, -34.0)),
        ("ellipsoid", (0.01, 3.37, -2.79), (3.0, -41.0)),
        ("ellipsoid", (-0.13, 3.1, -2.8), (-2.0, -31.0)),
    ],
)
def test_a_collision_with_several_solutions_creates_no_energy(hip, angle, speed):
    """The calf of a leg folds against its hip and its limit: one solution loses energy, another one gains it."""
    model = mujoco.MjModel.from_xml_string(FOLDED_LEG.format(hip))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[7:], data.qvel[7:] = angle, speed
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
    stepper.step(data)
    mujoco.mj_forward(model, data)
    assert stepper.sums.collisions > 0
    assert data.energy.sum() < 1.01 * before
    assert stepper.sums.inadmissible == 1


@pytest.mark.parametrize(
    ("hip", "angle", "speed"),
    [
        ("sphere", (0.04, 3.57, -2.82), (12.0, -44.0)),
        ("sphere", (-0.28, 3.59, -2.81), (-4.0, -31.0)),
        ("ellipsoid", (0.03, 3.4, -2.79), (13.0, -37.0)),
    ],
)
def test_event_and_sums_tell_which_of_several_solutions_the_step_took(hip, angle, speed):
    """Regression: by itself the event found another solution, or the one with E = 0, and told .8 of the speed wrong."""
    model = mujoco.MjModel.from_xml_string(FOLDED_LEG.format(hip))
    data = mujoco.MjData(model)
    data.qpos[7:], data.qvel[7:] = angle, speed
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
    stepper.step(data)
    change = stepper.sums.energy_change
    (event,) = stepper.events
    assert event.impact.restitution_scale > 0.0
    np.testing.assert_allclose(event.impact.post_velocity, data.qvel, atol=0.01 * abs(speed[1]))
    assert abs(change - event.impact.energy_change) < 1e-3 * event.impact.collision.kinetic_energy
