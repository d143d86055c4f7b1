"""Impacts of chains of bodies and of a rod under time stepping: the tables of the paper, every law."""

import mujoco
import numpy as np
import pytest
from scenes import energy
from stepping.time_stepping.stepped import first_impact, stepping

from impactlaw import Coulomb, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.models import builder, load

SWAP = [[0.0, 1.0], [1.0, 0.0]]
MIXED = [[0.25, 0.75], [0.75, 0.25]]
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
    """Later impacts find balls that hang up to the path of a step apart."""
    model, data = load("newtons_cradle")
    model.opt.timestep = 1e-3
    stepper = stepping(model, Fremond.reversal())
    before, event = first_impact(stepper, data)
    assert event.impact.post_velocity == pytest.approx([0, 0, 0, 0, 1], abs=1e-6)
    assert data.qvel == pytest.approx([0, 0, 0, 0, 1], abs=0.5 * 9.81 * 0.001**2 + 1e-6)  # with gravity during the step
    before, event = first_impact(stepper, data)
    assert len(event.contacts.labels) == 4
    assert event.impact.collision.pre_velocity == pytest.approx(before, abs=1e-12)
    assert event.impact.post_velocity == pytest.approx(before[::-1], abs=1e-6)
    assert before[4] == pytest.approx(-1.0, abs=1e-3)


def test_the_falling_rod_stands_on_its_dead_end():
    """The left end with e = 1, the right one with 0, as in the scene: gamma+ = (1, 0), Lambda = (5/6, 2/3) at 1 m/s."""
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


SWAPPED = {
    ("ball1/ball2", "ball4/ball5"): 1.0,
    ("ball2/ball3", "ball3/ball4"): 1.0,
    ("ball3/ball4", "ball2/ball3"): 1.0,
    ("ball4/ball5", "ball1/ball2"): 1.0,
}


@pytest.mark.parametrize("timestep", [9e-4, 1e-3, 1.25e-3])
@pytest.mark.parametrize("law", [Fremond.reversal(), Fremond(SWAPPED)], ids=["reversal", "by contacts"])
def test_a_cradle_swings_back_through_all_its_balls(law, timestep):
    """In the second collision the balls at rest separate by rounding, but are still coupled by the law."""
    model, data = load("newtons_cradle")
    model.opt.timestep = timestep
    stepper = stepping(model, law)
    for _ in range(round(1.1 / timestep)):
        stepper.step(data)
    assert data.qvel[0] < -0.9
    assert abs(data.qvel[1:]).max() < 1e-2
