"""Collisions of soft steps have the friction of the scene; other contacts stay MuJoCo's."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.quadrupeds import quadruped

from impactlaw import Coulomb, MaximalDissipation, Moreau, Poisson, Routh, Stepper
from impactlaw.errors import RestitutionError

BALL = (
    '<geom name="floor" type="plane" size="9 9 1"/>'
    '<body name="ball" pos="0 0 .12"><freejoint/><geom name="ball" size=".1" mass="1"/></body>'
)


def first_event(law, *, mu=0.1, cone="pyramidal", velocity=(1.0, 0.0, -1.0), **options):
    model, data = compiled(BALL, option=f'timestep="1e-3" cone="{cone}"', geom=f'friction="{mu}" condim="3"')
    data.qvel[:3] = velocity
    stepper = Stepper(model, law, contact_model="soft", **options)
    while not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    return event


def first_impact(law, **options):
    return first_event(law, **options).impact


@pytest.mark.parametrize("compiled_option", [None, "never"])
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_ball_slides_or_rolls_away(e, cone, compiled_option):
    """Solid sphere, I = 2/5 m r^2: it loses mu (1 + e) u by sliding, at most 2/7 of its speed, after which it rolls."""
    for mu in (0.1, 0.9):
        event = first_event(Moreau(e), mu=mu, cone=cone, compiled=compiled_option)
        impact, arm, inertia = event.impact, 0.1, 0.4 * 0.1**2
        before, after = impact.collision.pre_velocity, impact.post_velocity
        lost = min(mu * (1 + e) * -before[2], before[0] / (1.0 + arm**2 / inertia))
        np.testing.assert_allclose(after[:3], [before[0] - lost, 0.0, -e * before[2]], atol=1e-12)
        np.testing.assert_allclose(after[4] - before[4], lost * arm / inertia, rtol=1e-10)


GROUNDS = {
    "floor": '<geom name="ground" type="plane" size="9 9 1"/>',
    "racket": '<body mocap="true" pos="0 0 -.1"><geom name="ground" type="box" size="9 9 .1"/></body>',
}
SHAPES = {  # with the height of the body on the ground, m
    "ball": ('size=".02"', 0.02),
    "lying capsule": ('type="capsule" size=".02 .05" euler="0 90 0"', 0.02),
    "box on an edge": ('type="box" size=".06 .04 .02" euler="45 0 0"', 0.06 * np.sqrt(0.5)),
}


def first_collision(ground, shape, height, *, mu=0.3, **options):
    """Return the first collision of a body that falls at 5 m/s from a height, m, and moves along the ground, too."""
    things = f'{GROUNDS[ground]}<body name="it" pos="0 0 {height}"><freejoint/><geom name="it" {shape}/></body>'
    option = 'timestep="2e-3" gravity="0 0 0" integrator="Euler"'
    model, data = compiled(things, option=option, geom=f'friction="{mu}" condim="3" density="1000"')
    data.qvel[:3] = 3.0, 1.0, -5.0
    stepper = Stepper(model, Moreau(0.5), **options)
    while not stepper.events:
        stepper.step(data)
    return stepper.events[0]


@pytest.mark.parametrize("compiled_option", [None, "never"])
@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("shape", SHAPES)
def test_depth_does_not_change_what_friction_does(shape, ground, compiled_option):
    """Bodies that are 9 mm in the ground get the velocity that event-driven steps say, which locate the contact."""
    geom, lowest = SHAPES[shape]
    for mu in (0.1, 0.9):
        located = first_collision(ground, geom, lowest + 1e-3, mu=mu)
        soft = first_collision(ground, geom, lowest + 1e-3, mu=mu, contact_model="soft", compiled=compiled_option)
        np.testing.assert_allclose(soft.contacts.position[:, 2], -9e-3, atol=1e-9)
        np.testing.assert_allclose(soft.impact.post_velocity, located.impact.post_velocity, atol=1e-9)


@pytest.mark.parametrize("compiled_option", [None, "never"])
def test_two_bodies_keep_their_angular_momentum(compiled_option):
    things = "".join(
        f'<body name="{name}" pos="0 0 {z}"><freejoint/><geom name="{name}" size=".02"/></body>'
        for name, z in (("lower", 0.0), ("upper", 0.041))
    )
    model, data = compiled(things, option='timestep="2e-3" gravity="0 0 0"', geom='friction=".9"')
    data.qvel[:] = [1.0, 0.0, 5.0, 0.0, 100.0, 0.0, 0.0, 2.0, 0.0, 0.0, 200.0, 50.0]
    stepper, momenta = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled_option), []
    while not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    for velocity in (event.impact.collision.pre_velocity, event.impact.post_velocity):
        data.qpos[:], data.qvel[:] = event.qpos, velocity
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        momenta.append(data.subtree_angmom[0].copy())
    assert event.impact.friction_impulse.any()
    np.testing.assert_allclose(*momenta, rtol=1e-10)


@pytest.mark.parametrize("compiled_option", [None, "never"])
def test_friction_can_be_left_out(compiled_option):
    impact = first_impact(Moreau(0.5), mu=0.9, friction="ignore", compiled=compiled_option)
    before, after = impact.collision.pre_velocity, impact.post_velocity
    np.testing.assert_allclose(np.delete(after - before, 2), 0.0, atol=1e-14)


def test_the_convex_relaxation_separates_what_slides():
    exact, convex = (first_impact(Moreau(0.5), friction=option) for option in ("coulomb", "convex"))
    assert exact.post_contact_velocity[0] == pytest.approx(-0.5 * exact.collision.pre_contact_velocity[0])
    assert convex.post_contact_velocity[0] > exact.post_contact_velocity[0] + 0.01


@pytest.mark.parametrize(
    "law", [Coulomb(Poisson(0.5)), Poisson(0.5), Routh(0.6), Coulomb(Moreau(0.3), tangential_restitution=0.4)], ids=repr
)
def test_laws_with_friction_of_their_own(law):
    impact = first_impact(law, mu=0.2)
    with_friction = law if law.has_friction else Coulomb(law)
    expected = with_friction.resolve(impact.collision)
    np.testing.assert_allclose(impact.post_velocity, expected.post_velocity, atol=1e-12)
    assert np.abs(impact.friction_impulse).max() > 0.1


def test_coulomb_is_refused_where_friction_is_left_out():
    model, _ = compiled(BALL)
    with pytest.raises(RestitutionError, match='friction="ignore" leaves friction out'):
        Stepper(model, Coulomb(Moreau(0.5)), contact_model="soft", friction="ignore")


@pytest.mark.parametrize("compiled_option", [None, "never"])
def test_a_collision_leaves_alone_what_it_does_not_reach(compiled_option):
    """A box settles on the floor, too slowly to collide, while a ball lands beside it."""
    box = '<body name="box" pos="2 0 .0999"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>'
    model, data = compiled(BALL + box, option='timestep="1e-3"')
    data.qvel[2], data.qvel[8] = -2.0, -0.05
    alone, reference = data.qpos.copy(), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled_option)
    reference.qpos[:], reference.qvel[:] = alone, data.qvel
    events = []
    for _ in range(30):
        stepper.step(data)
        mujoco.mj_step(model, reference)
        events += stepper.events
    assert [event.contacts.labels for event in events] == [("floor/ball",)]
    np.testing.assert_allclose(data.qvel[6:], reference.qvel[6:], rtol=1e-6, atol=1e-9)


def height(model, data, law, steps, **options):
    stepper = None if law is None else Stepper(model, law, contact_model="soft", **options)
    for _ in range(steps):
        if stepper is None:
            mujoco.mj_step(model, data)
        else:
            stepper.step(data)
    mujoco.mj_kinematics(model, data)
    return data.xpos[1, 2]


@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
def test_a_robot_stands_as_high_as_under_mujoco(integrator):
    heights = []
    for law in (None, MaximalDissipation()):
        model, data, _ = quadruped(integrator=integrator, timestep=2e-3)
        data.qpos[2] += 0.1
        heights.append(height(model, data, law, 1000))
    assert heights[1] == pytest.approx(heights[0], abs=2e-3)


def trestle():
    """Return a weight on two legs with springs in their hinges, which spread without friction; it falls 10 cm."""
    x, z = 0.4 * np.sin(np.pi / 9), 0.4 * np.cos(np.pi / 9)
    legs = "".join(
        f'<body name="{name}"><joint axis="0 1 0" stiffness="20" damping=".5"/><geom type="capsule" size=".01" '
        f'fromto="0 0 0 {side * x} 0 {-z}" mass=".3" contype="0" conaffinity="0"/>'
        f'<geom name="{name}" size=".02" mass=".1" pos="{side * x} 0 {-z}"/></body>'
        for name, side in (("left", -1), ("right", 1))
    )
    return compiled(
        f"""<geom name="floor" type="plane" size="9 9 1"/><body name="top" pos="0 0 {z + 0.12}">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <geom type="box" size=".05 .05 .02" mass="8" contype="0" conaffinity="0"/>{legs}</body>""",
        option='timestep="2e-3" integrator="implicitfast"',
        geom='friction=".8"',
    )


@pytest.mark.parametrize("compiled_option", [None, "never"])
def test_feet_do_not_spread_where_they_land(compiled_option):
    mujocos, law, ignored = (
        height(*trestle(), law, 750, **({"compiled": compiled_option} if law else {}), **options)
        for law, options in ((None, {}), (MaximalDissipation(), {}), (MaximalDissipation(), {"friction": "ignore"}))
    )
    assert law == pytest.approx(mujocos, abs=2e-3)
    assert ignored < mujocos - 8e-3
