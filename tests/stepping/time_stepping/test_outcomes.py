"""Impacts under time stepping go as the law says: the tables of the paper, closed forms, every law."""

import math

import mujoco
import numpy as np
import pytest
from scenes import compiled, energy

from impactlaw import Coulomb, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Poisson, Stepper
from impactlaw.models import builder, load

SWAP = [[0.0, 1.0], [1.0, 0.0]]
MIXED = [[0.25, 0.75], [0.75, 0.25]]
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


THREE_BALLS = {
    "maximal dissipation": (MaximalDissipation(), (1 / 3, 1 / 3, 1 / 3), (2 / 3, 1 / 3)),
    "moreau 0": (Moreau(0), (1 / 3, 1 / 3, 1 / 3), (2 / 3, 1 / 3)),
    "moreau 1": (Moreau(1), (-1 / 3, 2 / 3, 2 / 3), (4 / 3, 2 / 3)),
    "moreau 1/2": (Moreau(0.5), (0.0, 1 / 2, 1 / 2), (1, 1 / 2)),
    "newton 1": (Newton(1.0), (-1 / 3, 2 / 3, 2 / 3), (4 / 3, 2 / 3)),
    "newton by contact": (
        Newton({("ball1", "ball2"): 1.0, ("ball2", "ball3"): 0.3}, default=0.0),
        (-1 / 3, 2 / 3, 2 / 3),
        (4 / 3, 2 / 3),
    ),
    "newton of speed": (Newton(lambda speed: 0.5 * speed), (0.0, 1 / 2, 1 / 2), (1, 1 / 2)),
    "poisson 1": (Poisson(1.0), (-1 / 3, 2 / 3, 2 / 3), (4 / 3, 2 / 3)),
    "fremond swap": (Fremond(SWAP), (0, 0, 1), (1, 1)),
    "fremond mixed": (Fremond(MIXED), (-1 / 12, 1 / 6, 11 / 12), (13 / 12, 11 / 12)),
    "fremond by contacts": (
        Fremond({("ball1/ball2", "ball2/ball3"): 1.0, ("ball2/ball3", "ball1/ball2"): 1.0}),
        (0, 0, 1),
        (1, 1),
    ),
    "reversal": (Fremond.reversal(), (0, 0, 1), (1, 1)),
    "linear map": (LinearMap(np.eye(3)[::-1]), (0, 0, 1), (1, 1)),
    "coulomb where nothing is rough": (Coulomb(Moreau(1)), (-1 / 3, 2 / 3, 2 / 3), (4 / 3, 2 / 3)),
}


@pytest.mark.parametrize("name", THREE_BALLS)
def test_three_balls_in_touch_leave_with_the_velocities_of_the_table(name):
    law, velocity, impulse = THREE_BALLS[name]
    model, data = load("ball_chain")
    stepper = stepping(model, law)
    _, event = first_impact(stepper, data)
    assert data.qvel == pytest.approx(velocity, abs=1e-9)
    assert event.contacts.labels == ("ball1/ball2", "ball2/ball3")
    assert event.impact.impulse == pytest.approx(impulse, abs=1e-9)
    assert event.impact.post_velocity == pytest.approx(velocity, abs=1e-9)
    assert stepper.shortfall < 1e-9


@pytest.mark.parametrize("launched", [1, 2, 3])
@pytest.mark.parametrize("n", [2, 5, 10, 100])
def test_a_cradle_passes_on_as_many_balls_as_come(n, launched):
    model = builder.chain(n, launched=min(launched, n - 1)).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    before = data.qvel.copy()
    stepping(model, Fremond.reversal()).step(data)
    assert data.qvel == pytest.approx(before[::-1], abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("n", [2, 5, 10])
def test_moreaus_law_on_a_chain_is_p_plus_e_times_p_minus_the_velocity_before(n, e):
    model = builder.chain(n, launched=1).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    before = data.qvel.copy()
    stepping(model, Moreau(e)).step(data)
    assert data.qvel == pytest.approx((1 + e) * before.mean() - e * before, abs=1e-9)


def test_the_swinging_cradle_reverses_its_velocities_in_its_first_two_impacts():
    """Later ones find balls that hang up to the way of a step apart."""
    model, data = load("newtons_cradle")
    model.opt.timestep = 1e-3
    stepper = stepping(model, Fremond.reversal())
    before, event = first_impact(stepper, data)
    assert event.impact.post_velocity == pytest.approx([0, 0, 0, 0, 1], abs=1e-6)
    assert data.qvel == pytest.approx([0, 0, 0, 0, 1], abs=0.5 * 9.81 * 0.001**2 + 1e-6)  # with gravity of the step
    before, event = first_impact(stepper, data)
    assert len(event.contacts.labels) == 4
    assert event.impact.collision.pre_velocity == pytest.approx(before, abs=1e-12)
    assert event.impact.post_velocity == pytest.approx(before[::-1], abs=1e-6)
    assert before[4] == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("timestep", [1e-4, 2e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_a_ball_leaves_the_floor_with_e_times_the_speed_it_came_with(e, timestep):
    ball = '<body pos="0 0 .13"><freejoint/><geom name="ball" size=".1" condim="1"/></body>'
    model, data = compiled(FLOOR + ball, option=f'timestep="{timestep}"')
    data.qvel[2] = -2.0
    stepper, bounces = stepping(model, Newton(e)), 0
    for _ in range(round(0.9 / timestep) if timestep > 1e-3 else 3000):
        before = data.qvel[2]
        stepper.step(data)
        if stepper.events and before < -0.1:
            bounces += 1
            assert data.qvel[2] == pytest.approx(-e * before, abs=1e-9)
    assert bounces >= 1 if e == 0 or timestep < 1e-3 else bounces >= 2


@pytest.mark.parametrize("timestep", [1e-3, 1e-2, 0.05])
@pytest.mark.parametrize("e", [0.3, 1.0])
def test_a_ball_between_two_walls_keeps_e_of_its_speed_at_each(e, timestep):
    """Without gravity, walls nearer than the way of a step at times: opens and closes within a step."""
    world = """<geom type="box" size=".1 1 1" pos="-1 0 0"/><geom type="box" size=".1 1 1" pos="1 0 0"/>
        <body><joint type="slide" axis="1 0 0"/><geom name="ball" size=".1"/></body>"""
    model, data = compiled(world, option=f'gravity="0 0 0" timestep="{timestep}"', geom='condim="1"')
    data.qvel[0] = 7.0
    stepper, hits = stepping(model, Newton(e)), 0
    for _ in range(400):
        before = data.qvel[0]
        stepper.step(data)
        hits += len(stepper.events)
        if abs(before) > 0.01:
            assert data.qvel[0] == pytest.approx(-e * before if stepper.events else before, abs=1e-9)
        assert abs(data.qpos[0]) < 0.8 + 7.0 * timestep / 2 + 1e-9
    assert hits >= (2 if e == 1 or timestep > 1e-3 else 1)


def test_the_falling_rod_stands_on_its_dead_end():
    """One end with e = 1, one with 0, as the scene says: gamma+ = (1, 0) and Lambda = (5/6, 2/3) at 1 m/s."""
    model, data = load("falling_rod")
    stepper = stepping(model, "scene")
    before, event = first_impact(stepper, data)
    u = -before[0]
    assert event.contacts.labels == ("floor/left", "floor/right")
    assert event.impact.collision.pre_contact_velocity == pytest.approx([-u, -u], abs=1e-12)
    assert event.impact.post_contact_velocity == pytest.approx([u, 0], abs=1e-9)
    assert event.impact.impulse == pytest.approx([5 / 6 * u, 2 / 3 * u], abs=1e-9)
    assert data.qvel == pytest.approx([u / 2, u / 2], abs=1e-9)
    assert u == pytest.approx(1.0, abs=model.opt.timestep)


ROD_LAWS = {
    "newton by pairs": (Newton({("left", "floor"): 1.0, ("right", "floor"): 0.5}), lambda u: (u, u / 2)),
    "newton by pairs and default": (Newton({("left", "floor"): 1.0}, default=0.5), lambda u: (u, u / 2)),
    "newton of speed": (Newton(lambda speed: min(1.0, 0.4 * speed)), lambda u: (0.4 * u**2, 0.4 * u**2)),
    "newton of speed by pairs": (
        Newton({("left", "floor"): lambda speed: 0.4 * speed}, default=0.0),
        lambda u: (0.4 * u**2, 0.0),
    ),
    "poisson": (Poisson(0.5), lambda u: (u / 2, u / 2)),
    "poisson of two": (Poisson({("left", "floor"): 1.0}, default=0.5), lambda u: (1.5 * u, 0.0)),
    "poisson of speed": (Poisson(lambda speed: 0.5 * speed), lambda u: (0.5 * u**2, 0.5 * u**2)),
    "moreau": (Moreau(0.25), lambda u: (u / 4, u / 4)),
    "reversal": (Fremond.reversal(0.5), lambda u: (u / 2, u / 2)),
    "fremond by contacts": (
        Fremond({("floor/left", "floor/right"): 0.5, ("floor/right", "floor/left"): 0.25}),
        lambda u: (u / 2, u / 4),
    ),
    "maximal dissipation": (MaximalDissipation(), lambda u: (0.0, 0.0)),
    "linear map": (LinearMap([[-0.5, 0], [0, 1]]), lambda u: (u / 2, u / 2)),
}


@pytest.mark.parametrize("name", ROD_LAWS)
def test_the_rod_under_every_law(name):
    law, expected = ROD_LAWS[name]
    model, data = load("falling_rod")
    before, event = first_impact(stepping(model, law), data)
    expected = expected(-before[0])
    left, right = data.qvel[0] + data.qvel[1], data.qvel[0] - data.qvel[1]
    assert (left, right) == pytest.approx(expected, abs=1e-9)
    assert event.impact.post_contact_velocity == pytest.approx(expected, abs=1e-9)


def test_a_law_as_an_own_class_is_asked():
    from impactlaw.laws import Law, Target

    class HalfOfTheSpeed(Law):
        def target(self, collision):
            return Target(np.maximum(-0.5 * collision.pre_contact_velocity, 0.0))

    model, data = load("ball_chain")
    stepping(model, HalfOfTheSpeed()).step(data)
    assert data.qvel == pytest.approx([0, 0.5, 0.5], abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_billiards_keep_momentum_and_at_e_1_energy(e):
    model, data = load("billiard_rack")
    before, momentum = energy(model, data), np.array([data.qvel[0::2].sum(), data.qvel[1::2].sum()])
    stepper, last = stepping(model, Moreau(e)), np.inf
    broken = False
    for _ in range(300):
        stepper.step(data)
        now = energy(model, data)
        assert now <= min(last, before) * (1 + 1e-9)
        last = now
        if e == 1:
            assert now == pytest.approx(before, rel=1e-9)
        labels = [label for event in stepper.events for label in event.contacts.labels]
        broken = broken or bool(labels)
        if any("cushion" in label for label in labels) or not all(
            "ball" in label or "cue" in label for label in labels
        ):
            break
        assert data.qvel[0::2].sum() == pytest.approx(momentum[0], abs=1e-9)
        assert data.qvel[1::2].sum() == pytest.approx(momentum[1], abs=1e-9)
    assert broken


def test_the_break_of_the_rack_has_all_its_contacts_and_the_closed_form():
    model, data = load("billiard_rack")
    stepper = stepping(model, "scene")
    before, event = first_impact(stepper, data)
    u, e = before[0], 0.95
    assert len(event.contacts.labels) == 31
    assert data.qvel[0] == pytest.approx(u * (8 * (1 + e) / 70 - e), abs=1e-6)
    T = 0.5 * 0.17 * data.qvel @ data.qvel
    assert T / (0.5 * 0.17 * u**2) == pytest.approx(e**2 + (1 - e**2) * 4 / 35, abs=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_joint_limit_has_restitution(e):
    world = '<body><joint name="rail" type="slide" axis="1 0 0" range="-1 2"/><geom size=".1" mass="3"/></body>'
    model, data = compiled(world, option='gravity="0 0 0" timestep="0.01"')
    data.qvel[0] = 3.7
    stepper = stepping(model, Newton({"rail": e}))
    before, event = first_impact(stepper, data)
    assert data.qvel[0] == pytest.approx(-e * before[0], abs=1e-9)
    assert event.contacts.labels == ("rail",)
    assert event.impact.impulse == pytest.approx([3 * (1 + e) * 3.7], abs=1e-9)
    assert 2.0 - (1 + e / 2) * 3.7 * 0.01 - 1e-9 < data.qpos[0] < 2.0 + 1e-9  # within the way of a step, never beyond


def test_a_ball_joint_and_a_tendon_have_limits_with_restitution():
    world = '<body><joint name="hip" type="ball" range="0 30"/><geom type="box" size=".1 .2 .3"/></body>'
    model, data = compiled(world, option='gravity="0 0 0" timestep="0.01"')
    data.qvel[:] = 0.0, 2.0, 0.0
    _, event = first_impact(stepping(model, Moreau(0.5)), data)
    assert event.contacts.labels == ("hip",)
    assert data.qvel == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)

    world = """<site name="hook"/><body name="mass" pos="1 0 0"><joint type="slide" axis="1 0 0"/>
        <geom size=".1" mass="2"/><site name="mass"/></body>"""
    rest = '<tendon><spatial name="string" range="0 2"><site site="hook"/><site site="mass"/></spatial></tendon>'
    model, data = compiled(world, rest, option='gravity="0 0 0" timestep="0.01"')
    data.qvel[0] = 3.0
    _, event = first_impact(stepping(model, Moreau(0.5)), data)
    assert event.contacts.labels == ("string",)
    assert data.qvel == pytest.approx([-1.5], abs=1e-9)


def oblique(mu, e, e_t=0.0, *, spin=0.0, vx=3.0, vz=-2.0):
    """A solid ball hits the floor obliquely: velocity after by Coulomb's law in closed form, and that of a step.

    It is in touch in the middle of the step, where the lever of friction is its radius.
    """
    r, m = 0.1, 1.0
    ball = f'<body pos="0 0 {r - 0.001 * vz}"><freejoint/><geom size="{r}" mass="{m}"/></body>'
    model, data = compiled(FLOOR + ball, option='gravity="0 0 0"', geom=f'friction="{mu} 0 0" condim="3"')
    data.qvel[0], data.qvel[2], data.qvel[4] = vx, vz, spin
    law = Coulomb(Newton(e), tangential_restitution=e_t) if e_t else Newton(e)
    stepper = stepping(model, law)
    _, event = first_impact(stepper, data)
    normal = -m * (1 + e) * vz
    slip = vx - r * spin
    sticking = -2 / 7 * m * (1 + e_t) * slip
    tangential = np.clip(sticking, -mu * normal, mu * normal)
    expected = np.zeros(6)
    expected[[0, 2, 4]] = vx + tangential / m, -e * vz, spin - r * tangential / (0.4 * m * r**2)
    return data.qvel.copy(), expected, event


@pytest.mark.parametrize(("mu", "e", "e_t", "spin"), [
    (0.1, 0.5, 0.0, 0.0),
    (0.5, 0.5, 0.0, 0.0),
    (0.1, 1.0, 0.0, 40.0),
    (0.9, 0.0, 0.0, -20.0),
    (2.0, 0.8, 0.8, 0.0),
    (0.3, 0.5, 1.0, 0.0),
    (2.0, 1.0, 1.0, 0.0),
])  # fmt: skip
def test_an_oblique_impact_follows_coulombs_closed_form(mu, e, e_t, spin):
    got, expected, event = oblique(mu, e, e_t, spin=spin)
    assert got == pytest.approx(expected, abs=1e-9)
    assert event.impact.post_velocity == pytest.approx(expected, abs=1e-8)


def test_the_convex_relaxation_of_an_oblique_impact_is_another_one():
    """u in K: the normal velocity aimed at grows by mu times the slip, so that what slides also hops."""
    ball = '<body pos="0 0 .101"><freejoint/><geom size=".1" mass="1"/></body>'
    model, data = compiled(FLOOR + ball, option='gravity="0 0 0"', geom='friction=".1 0 0" condim="3"')
    data.qvel[[0, 2]] = 3.0, -2.0
    stepper = stepping(model, Newton(0.5), friction="convex")
    first_impact(stepper, data)
    assert data.qvel[2] > 1.05
    assert energy(model, data) < 0.5 * (9 + 4)


def test_friction_can_be_ignored_in_an_impact():
    ball = '<body pos="0 0 .101"><freejoint/><geom size=".1" mass="1"/></body>'
    model, data = compiled(FLOOR + ball, option='gravity="0 0 0"')
    data.qvel[[0, 2]] = 3.0, -2.0
    first_impact(stepping(model, Newton(0.5), friction="ignore"), data)
    assert data.qvel == pytest.approx([3, 0, 1, 0, 0, 0], abs=1e-9)


def test_mass_ratios_and_sizes_do_not_matter_to_the_law():
    for mass in (1e-6, 1.0, 1e6):
        for size in (1e-3, 1.0, 1e3):
            world = f"""<body><joint type="slide" axis="1 0 0"/><geom size="{size}" mass="1"/></body>
                <body pos="{2.5 * size} 0 0"><joint type="slide" axis="1 0 0"/>
                <geom size="{size}" mass="{mass}"/></body>"""
            model, data = compiled(world, option='gravity="0 0 0" timestep="0.01"', geom='condim="1"')
            data.qvel[0] = 10 * size
            first_impact(stepping(model, Newton(0.7)), data)
            common = 10 * size / (1 + mass)
            expected = [common - 0.7 * 10 * size * mass / (1 + mass), common + 0.7 * 10 * size / (1 + mass)]
            assert data.qvel == pytest.approx(expected, rel=1e-8, abs=1e-8 * size)


def test_a_contact_hit_through_its_neighbour_across_an_open_gap_keeps_its_restitution():
    """Two equal balls 1 mm apart, the first one struck: with e = 1 the struck one stops and the other takes it on."""
    world = "".join(
        f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'
        for x in (0, 0.201, 0.402, 0.603)
    )
    model, data = compiled(world, option='gravity="0 0 0" timestep="0.01"', geom='condim="1"')
    data.qvel[0] = 1.0
    stepper = stepping(model, Newton(1.0))
    for _ in range(50):
        stepper.step(data)
    assert data.qvel == pytest.approx([0, 0, 0, 1], abs=1e-9)
    assert 0.5 * data.qvel @ data.qvel == pytest.approx(0.5, abs=1e-9)


def test_the_time_of_flight_of_a_slope_goes_with_its_angle():
    """A frictionless ball dropped on a slope of 30 degrees keeps its tangential velocity, e = 1/2 of the normal one."""
    slope = f'<geom name="slope" type="plane" size="9 9 1" zaxis="{math.sin(math.pi / 6)} 0 {math.cos(math.pi / 6)}"/>'
    ball = '<body pos="0 0 .5"><freejoint/><geom size=".1"/></body>'
    model, data = compiled(slope + ball, geom='condim="1"')
    before, _ = first_impact(stepping(model, Newton(0.5)), data)
    n = np.array([math.sin(math.pi / 6), 0, math.cos(math.pi / 6)])
    t = np.array([n[2], 0, -n[0]])
    h = model.opt.timestep
    assert data.qvel[:3] @ n == pytest.approx(-0.5 * before[:3] @ n, abs=1e-9)
    assert data.qvel[:3] @ t == pytest.approx(before[:3] @ t - 9.81 * h * t[2], abs=1e-9)
