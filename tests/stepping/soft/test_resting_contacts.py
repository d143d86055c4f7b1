"""A body at rest on several soft contacts is hit: all of them take part, though some open slightly."""

import copy

import mujoco
import numpy as np
import pytest
from scenes import INTEGRATORS, compiled

from impactlaw import Moreau, Stepper
from impactlaw.laws.fremond import Reversal
from impactlaw.models.builder import cradle

BOX = """<geom name="floor" type="plane" size="9 9 1"/>
    <body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1"/></body>
    <body pos="0 0 {height}"><freejoint/><geom name="ball" size=".1" mass="1"/></body>"""


def hit(integrator, code, e, height, wobble=0.0):
    """Return the velocity after the ball has hit the box at rest, the stepper, and the speed of the ball before."""
    model, data = compiled(BOX.format(height=height), option=f'timestep="2e-3" integrator="{integrator}"')
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=code)
    for _ in range(2000):
        data.qvel[3] += wobble
        speed = -data.qvel[8]
        stepper.step(data)
        if stepper.sums.energy_change < -0.5:
            return data.qvel.copy(), stepper, speed
    raise AssertionError("nothing collided")


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_box_on_four_corners_stays_where_it_is(integrator, code):
    """The outcome is that of five simultaneous contacts: the ball leaves with e times its speed."""
    for e, height in ((0.0, 5.0), (0.5, 1.0), (0.5, 5.0), (0.5, 12.0)):
        velocity, stepper, speed = hit(integrator, code, e, height)
        assert [len(event.contacts) for event in stepper.events] == [5]
        assert stepper.sums.inadmissible == 0
        assert np.abs(velocity[[0, 1, 3, 4, 5]]).max() < 1e-8
        assert abs(velocity[2]) < 1e-3
        assert velocity[8] == pytest.approx(e * speed, abs=0.03 * speed)


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize("wobble", [1e-12, 1e-9, 1e-6, 1e-3])
def test_how_it_trembles_does_not_decide(wobble, code):
    """Two corners open by up to 1e-4 m/s: the outcome changes only by some of that."""
    still, _, _ = hit("Euler", code, 0.5, 5.0)
    velocity, stepper, _ = hit("Euler", code, 0.5, 5.0, wobble)
    assert velocity == pytest.approx(still, abs=20 * wobble + 1e-7)
    assert stepper.sums.inadmissible == 0


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize(("opening", "contacts"), [(0.009, [2]), (0.011, [1, 2])])
def test_what_separates_is_hit_afterwards(opening, contacts, code):
    """Contacts count as separating if they open faster than a tenth of the least speed of collisions, 0.1 m/s."""
    world = """<geom name="wall" type="plane" size="9 9 1" zaxis="1 0 0"/>
        <body pos=".0999 0 0"><joint type="slide" axis="1 0 0"/><geom name="a" size=".1" mass="1"/></body>
        <body pos=".2998 0 0"><joint type="slide" axis="1 0 0"/><geom name="b" size=".1" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="1e-12" gravity="0 0 0"', geom='solref=".02 1"')
    data.qvel[:] = opening, -5.0
    stepper = Stepper(model, Moreau(0.0), contact_model="soft", compiled=code)
    stepper.step(data)
    assert [len(event.contacts) for event in stepper.events] == contacts
    assert np.abs(data.qvel).max() < 1e-6


def test_a_law_of_all_contacts_is_not_told_that_one_trembles():
    """Under the reversal law each contact aims at its mirror image's velocity, so opening could become closing."""
    model = cradle(5).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    stepper = Stepper(model, Reversal(1.0), contact_model="soft", on_inadmissible="raise")
    opened = 0.0
    for _ in range(3000):
        stepper.step(data)
        for event in stepper.events:
            opened = max(opened, event.impact.collision.pre_contact_velocity.max())
            assert event.impact.violations.is_admissible()
    assert opened > 1e-6


@pytest.mark.parametrize("code", ["auto", "never"])
@pytest.mark.parametrize("timestep", [0.01, 0.02])
@pytest.mark.parametrize("geom", ['type="box" size=".1 .1 .1"', 'type="capsule" size=".05 .2"'])
def test_what_has_fallen_comes_to_rest_in_large_timesteps(geom, timestep, code):
    """In a timestep gravity gives more than 0.1 m/s to what the law has thrown up slowly."""
    world = f"""<geom type="plane" size="9 9 1"/>
        <body pos="0 0 .4" euler="10 20 0"><freejoint/><geom {geom}/></body>"""
    model, data = compiled(world, option=f'timestep="{timestep}"')
    stepper, late = Stepper(model, Moreau(0.1), contact_model="soft", compiled=code), 0
    for _ in range(int(4 / timestep)):
        stepper.step(data)
        late += data.time > 3 and len(stepper.events) > 0
    assert late == 0
    assert np.abs(data.qvel).max() < 1e-3


@pytest.mark.parametrize("code", ["auto", "never"])
def test_what_is_at_rest_depends_on_the_timestep_and_gravity_of_now(code):
    """The least speed of collisions is 1.5 times what gravity gives in a timestep: 0.29, 0.1 and 0.3 m/s here."""
    model, start = compiled(BOX.format(height=9), option='timestep="0.02"')
    start.qpos[2], start.qvel[2] = 0.0999, -0.2
    stepper, collisions = Stepper(model, Moreau(0.5), contact_model="soft", compiled=code), []
    for timestep, gravity in ((0.02, -9.81), (0.002, -9.81), (0.002, -100.0), (0.002, -9.81)):
        model.opt.timestep, model.opt.gravity[2] = timestep, gravity
        stepper.step(copy.copy(start))
        collisions.append(stepper.sums.collisions)
    assert collisions == [0, 1, 0, 1]
