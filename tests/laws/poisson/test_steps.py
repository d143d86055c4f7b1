"""Poisson's law on chains, under sudden motion of surfaces and in steps; invalid coefficients."""

import mujoco
import numpy as np
import pytest
from problems import (
    balls,
    launched,
    sparse_chain,
)
from scenes import compiled

from impactlaw import Collision, Poisson, Stepper, make_law
from impactlaw.errors import RestitutionError, UnsolvableLawError
from impactlaw.models import load


def test_sparse_chain_is_the_dense_one():
    rng = np.random.default_rng(56)
    masses, v = rng.uniform(0.5, 2.0, 121), rng.normal(size=121)
    law = Poisson(rng.uniform(size=120).tolist())
    sparse, dense = law.resolve(sparse_chain(masses, v)), law.resolve(balls(masses, v))
    np.testing.assert_allclose(sparse.post_velocity, dense.post_velocity, rtol=0, atol=1e-10)
    np.testing.assert_allclose(sparse.impulse, dense.impulse, rtol=0, atol=1e-10)
    assert sparse.residual < 1e-12


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_hammer_blow_under_a_ball(e):
    """The table jumps to velocity u before compression: relative to it, the ball leaves with e u."""
    u, m = 2.0, 3.0
    c = Collision([[m]], [[1.0]], [0.0], post_surface_velocity=[-u])
    impact = Poisson(e).resolve(c)
    assert impact.post_velocity[0] == pytest.approx((1 + e) * u, rel=1e-14)
    assert impact.post_contact_velocity[0] == pytest.approx(e * u, abs=1e-14)
    assert impact.collision.pre_contact_velocity.tolist() == [-u]
    assert impact.surface_work == pytest.approx(m * (1 + e) * u * u, rel=1e-14)
    assert impact.energy_change == pytest.approx(0.5 * m * ((1 + e) * u) ** 2, rel=1e-14)
    assert impact.violations.is_admissible()


def test_hammer_blow_in_rigid_steps():
    """A table under two balls jumps to u: compression takes both along, expansion throws both off with e u."""
    e, u, h = 0.5, 2.0, 0.01
    world = """<body name="table" mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/></body>
        <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom name="low" size=".1" mass="1"/></body>
        <body pos="0 0 .3"><joint type="slide" axis="0 0 1"/><geom name="high" size=".1" mass="2"/></body>"""
    model, data = compiled(world, option=f'timestep="{h}" integrator="RK4"', geom='condim="1"')
    stepper = Stepper(model, Poisson(e))
    for _ in range(3):
        stepper.step(data)
        assert stepper.events == ()
    data.mocap_pos[0, 2] = u * h
    stepper.step(data)
    (event,) = stepper.events
    np.testing.assert_allclose(event.impact.post_velocity, (1 + e) * u, rtol=1e-9)
    np.testing.assert_allclose(sorted(event.impact.impulse), (1 + e) * u * np.array([2.0, 3.0]), rtol=1e-9)
    assert event.impact.violations.is_admissible()
    np.testing.assert_allclose(data.qpos, (1 + e) * u * h - 0.5 * 9.81 * h * h, rtol=1e-9)


def test_surfaces_that_crush_what_is_between_them():
    between = Collision([[2.0]], [[1.0], [-1.0]], [0.0], surface_velocity=[-1.0, -1.0], labels=("left", "right"))
    with pytest.raises(UnsolvableLawError, match="left, right"):
        Poisson(0.5).resolve(between)


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_stepping(contact_model):
    """The scene's rod on an elastic and a dead end: impulses (1, 3/4) u, as by hand above, and both ends open."""
    model, data = load("falling_rod")
    law = make_law("poisson", {("left", "floor"): 1.0, ("right", "floor"): 0.0})
    stepper = Stepper(model, law, contact_model=contact_model)
    while data.time < 1.1 and not stepper.events:
        stepper.step(data)
    event, *_ = stepper.events
    assert event.contacts.labels == ("floor/left", "floor/right")
    u = -event.impact.collision.pre_velocity[0]
    assert u == pytest.approx(1.0, abs=1e-9 if contact_model == "rigid" else 0.01)
    np.testing.assert_allclose(event.impact.impulse, (u, 0.75 * u), rtol=1e-9)
    np.testing.assert_allclose(event.impact.post_contact_velocity, (1.5 * u, 0.0), rtol=1e-9, atol=1e-9)


def test_elastic_cradle_keeps_its_energy_in_rigid_steps():
    model, data = load("newtons_cradle")
    stepper = Stepper(model, Poisson(1.0))
    energies, collisions = [], 0
    while data.time < 2.0:
        stepper.step(data)
        collisions += len(stepper.events)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energies.append(data.energy.sum())
    assert collisions >= 2
    assert np.ptp(energies) < 1e-8 * max(map(abs, energies))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Poisson(2.0), r"must lie in \[0, 1\]"),
        (lambda: Poisson(0.5, default=0.5), "Poisson's default is for a mapping"),
        (lambda: Poisson([0.5]).resolve(launched(3, 1)), r"Poisson has 1 coefficients but 2 contacts collide \(0, 1\)"),
        (lambda: Poisson({"a/b": 0.5}).resolve(launched(3, 1)), "no restitution for contact 0, and no default"),
        (lambda: make_law("poisson"), "law 'poisson' needs a restitution"),
    ],
)
def test_wrong_restitution(make, message):
    with pytest.raises(RestitutionError, match=message):
        make()
