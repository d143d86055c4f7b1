"""Oblique impacts under time stepping follow Coulomb's closed form."""

import math

import numpy as np
import pytest
from scenes import compiled, energy
from stepping.time_stepping.stepped import FLOOR, first_impact, stepping

from impactlaw import Coulomb, Newton


def oblique(mu, e, e_t=0.0, *, spin=0.0, vx=3.0, vz=-2.0):
    """Return the velocity after a solid ball hits the floor obliquely, by Coulomb's closed form and by a step.

    The ball touches the floor in the middle of the step, where the lever of friction is its radius.
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
    """u in K: the target normal velocity grows by mu times the slip, so that sliding bodies also hop."""
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


def test_the_time_of_flight_of_a_slope_goes_with_its_angle():
    """A frictionless ball dropped on a slope of 30 degrees keeps its tangential and half of its normal velocity."""
    slope = f'<geom name="slope" type="plane" size="9 9 1" zaxis="{math.sin(math.pi / 6)} 0 {math.cos(math.pi / 6)}"/>'
    ball = '<body pos="0 0 .5"><freejoint/><geom size=".1"/></body>'
    model, data = compiled(slope + ball, geom='condim="1"')
    before, _ = first_impact(stepping(model, Newton(0.5)), data)
    n = np.array([math.sin(math.pi / 6), 0, math.cos(math.pi / 6)])
    t = np.array([n[2], 0, -n[0]])
    h = model.opt.timestep
    assert data.qvel[:3] @ n == pytest.approx(-0.5 * before[:3] @ n, abs=1e-9)
    assert data.qvel[:3] @ t == pytest.approx(before[:3] @ t - 9.81 * h * t[2], abs=1e-9)
