"""A table that jumps in velocity below bodies that slide on it, with friction."""

import math

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Collision, Coulomb, Friction, MaximalDissipation, Moreau, Newton, Poisson, Stepper

TABLE = '<body name="table" mocap="true"><geom name="table" type="box" size="2 2 .1" pos="0 0 -.1"/></body>'


def leaning_rod(side: float):
    """Return a rod that touches the table, at 30 degrees to its normal, and slides at 0.5 m/s."""
    x, z = side * 0.25, 0.5 * math.cos(math.pi / 6)
    joints = "".join(f'<joint type="{kind}" axis="{axis}"/>' for kind, axis in (
        ("slide", "1 0 0"), ("slide", "0 0 1"), ("hinge", "0 1 0"),
    ))  # fmt: skip
    rod = f'<geom name="rod" type="capsule" size=".02" fromto="{x} 0 {z} {-x} 0 {-z}" mass="1"/>'
    return f'<body pos="0 0 {z + 0.02}">{joints}{rod}</body>'


def struck(law, body, speed=(0.0, 0.0, 1.0), **options):
    """Return the collision of a body that slides on a table at rest, which from then on moves at a given speed."""
    option = 'timestep="0.002" gravity="0 0 0" integrator="RK4"'
    model, data = compiled(TABLE + body, option=option, geom='friction="0.2"')
    data.qvel[0] = 0.5
    stepper = Stepper(model, law, **options)
    for _ in range(2):
        stepper.step(data)
    data.mocap_pos[0] = np.array(speed) * model.opt.timestep
    stepper.step(data)
    (event,) = stepper.events
    return event.impact


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(0.0), Moreau(0.5), Newton(1.0)])
def test_a_rod_goes_along_with_the_table_as_under_time_stepping(law, side):
    """Sliding reverses during the blow: friction acts along the mean sliding velocity, and creates no energy."""
    impact = struck(law, leaning_rod(side))
    assert impact.violations.is_admissible()
    assert impact.restitution_scale == 1.0
    assert impact.post_contact_velocity == pytest.approx([0.0], abs=1e-12)
    assert impact.work_after_jump < 0.0
    later = struck(MaximalDissipation(), leaning_rod(side), scheme="time-stepping")
    np.testing.assert_allclose(impact.post_velocity, later.post_velocity, atol=2e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_poisson_compresses_after_the_jump_with_friction_as_without(side):
    impact = struck(Poisson(0.5), leaning_rod(side))
    assert impact.violations.is_admissible()
    assert impact.collision.surface_jump is None
    assert impact.collision.pre_contact_velocity == pytest.approx([-1.0])


def test_a_block_that_is_thrown_by_poisson_leaves_with_restitution():
    """v+ = (1 + e) w, and surfaces do the work Lambda w, with and without friction."""
    box = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="8"/></body>'
    for options in ({}, {"friction": "ignore"}):
        impact = struck(Poisson(0.5), box, **options)
        assert impact.post_velocity[2] == pytest.approx(1.5)
        assert impact.surface_work == pytest.approx(8 * 1.5)
        assert impact.violations.is_admissible()


def test_what_rests_on_a_table_that_is_struck():
    """Event-driven steps see gamma- = 0 before the blow, so no restitution; the others see gamma- = -w, so e w."""
    box = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="8"/></body>'
    for law in (Moreau(0.5), Newton(0.5)):
        assert struck(law, box).post_velocity[2] == pytest.approx(1.0)
        assert struck(law, box, scheme="time-stepping").post_velocity[2] == pytest.approx(1.5)
        assert struck(law, box, contact_model="soft").post_velocity[2] == pytest.approx(1.5, abs=5e-3)


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_what_only_surfaces_create_is_not_searched_for(e):
    """A belt reverses and a floor jumps: gamma- = 0, so that there is no restitution to scale."""
    belt = Friction([[1, 0]], [0], [0.3], surface_velocity=[0.0], post_surface_velocity=[-3.0])
    floor = {"surface_velocity": [0.0], "post_surface_velocity": [-1.0], "friction": belt}
    impact = Coulomb(Moreau(e)).resolve(Collision(np.eye(2), [[0, 1]], [2.0, 0.0], **floor))
    np.testing.assert_allclose(impact.post_velocity, [2.3, 1.0], atol=1e-12)
    assert impact.work == pytest.approx(0.3 * 0.5 * (2.0 - 0.7))
    assert impact.work_after_jump == pytest.approx(-0.5 + 0.3 * 0.5 * (-1.0 - 0.7))
    assert impact.violations.is_admissible()
