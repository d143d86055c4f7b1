"""Impacts on floors, walls and limits under time stepping return e times the speed."""

import pytest
from scenes import compiled
from stepping.time_stepping.stepped import FLOOR, first_impact, stepping

from impactlaw import Moreau, Newton


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
    """Without gravity, with walls sometimes closer than the path of a step: contacts open and close within a step."""
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
    assert 2.0 - (1 + e / 2) * 3.7 * 0.01 - 1e-9 < data.qpos[0] < 2.0 + 1e-9  # within the path of a step, never beyond


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
    """Equal balls 1 mm apart, the first one moving: with e = 1 each stops when it hits, and the next one moves on."""
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
