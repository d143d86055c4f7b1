"""A law with scatter: the range of its samples, their distribution, and repeatable runs."""

import numpy as np
import pytest
from problems import launched, rod
from scenes import compiled

from impactlaw import AnyOutcome, Collision, Coulomb, Moreau, Newton, Routh, Scattered, Stepper
from impactlaw.errors import InvalidCollisionError, RestitutionError
from impactlaw.models import load


def test_samples_are_in_the_admissible_set():
    for c in (launched(3, 1), launched(5, 2), rod()):
        law = Scattered(Moreau(0.7), 0.2)
        for v in law.sample(c, 50, 1):
            assert c.admissible_set.contains(v, 1e-9)
        assert c.admissible_set.contains(law.resolve(c).post_velocity, 1e-9)


@pytest.mark.parametrize("n", [-1, 2.5, None])
def test_a_number_of_samples_that_is_none(n):
    for sampled in (Collision(np.eye(2), np.eye(2), [-1.0, -1.0]), Collision(np.eye(2), -np.eye(2), [-1.0, -1.0])):
        with pytest.raises(InvalidCollisionError, match="n must be a whole number, 0 or more"):
            Scattered(Newton(0.5), 0.1).sample(sampled, n, 1)


def test_no_collision_and_no_generator():
    law = Scattered(Newton(0.5), 0.1)
    with pytest.raises(InvalidCollisionError, match="this takes a Collision, got None"):
        law.sample(None, 1, 0)
    for sampled in (Collision(np.eye(2), np.eye(2), [-1.0, -1.0]), Collision(np.eye(2), -np.eye(2), [-1.0, -1.0])):
        with pytest.raises(InvalidCollisionError, match="rng is a numpy generator, or a seed for one, got 'x'"):
            law.sample(sampled, 2, "x")


@pytest.mark.parametrize("seed", [None, 3])
def test_it_prints_what_was_given_first(seed):
    law = Scattered(Moreau(0.7), 0.2, seed=seed)
    assert repr(law) == f"Scattered(law=Moreau(restitution=0.7), covariance=0.2, seed={seed})"
    assert repr(AnyOutcome(seed=seed)) == f"AnyOutcome(seed={seed})"


def test_spread_is_the_covariance():
    """Inside S no sample is projected: relative errors in the kinetic metric have the given covariance."""
    c = Collision(np.diag([1.0, 2.0]), np.eye(2), [-1.0, -1.0])
    C = np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    law = Scattered(Newton(0.5), C)
    middle = Newton(0.5).resolve(c).post_velocity
    delta = c.metric.whiten(law.sample(c, 4000, 2) - middle) / c.pre_speed
    np.testing.assert_allclose(np.cov(delta.T), C, rtol=0.1, atol=1e-5)
    np.testing.assert_allclose(delta.mean(axis=0), 0.0, atol=2e-3)


def test_nothing_is_scattered_where_there_is_no_admissible_set():
    """A wall whose velocity jumps, and another wall behind the body at rest."""
    walls = {"surface_velocity": [-1.0, 0.0], "post_surface_velocity": [-2.0, 0.0]}
    c = Collision([[1.0]], [[1.0], [2.0]], [0.0], **walls)
    assert not c.has_admissible_set
    v = Scattered(Moreau(0.0), 0.5).resolve(c).post_velocity
    np.testing.assert_allclose(v, Moreau(0.0).resolve(c).post_velocity, rtol=0, atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}])
def test_a_blow_from_below_ends_no_run(options):
    """A ball rests on a table that suddenly rises at 2 m/s: this is a collision for which there is no S(v-)."""
    world = """<body mocap="true" pos="0 0 -.1"><geom type="box" size="1 1 .1"/></body>
        <body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/></body>"""
    model, data = compiled(world)
    stepper, fastest = Stepper(model, Scattered(Moreau(0.5), 0.01), **options), 0.0
    for i in range(60):
        data.mocap_pos[0, 2] = -0.1 + max(0.0, 0.004 * (i - 19))
        stepper.step(data)
        fastest = max(fastest, data.qvel[2])
    assert 1.9 < fastest < 3.2


def test_nothing_but_the_law_without_variance():
    c = launched(4, 2)
    np.testing.assert_allclose(
        Scattered(Moreau(0.4), 0.0).resolve(c).post_velocity, Moreau(0.4).resolve(c).post_velocity, rtol=0, atol=1e-9
    )


def test_a_run_can_be_repeated_and_seeds_differ():
    c = launched(3, 1)
    one, again, other = (Scattered(Moreau(0.5), 0.01, seed=s).resolve(c).post_velocity for s in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-4
    assert np.abs(one - Moreau(0.5).resolve(c).post_velocity).max() > 1e-4


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
def test_in_every_way_to_step(options):
    model, data = load("newtons_cradle")
    stepper = Stepper(model, Scattered(Moreau(0.8), 0.01), **options)
    while data.time < 1.5 and not stepper.events:
        stepper.step(data)
    assert stepper.events[0].impact.violations.is_admissible(1e-8)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scattered(0.5, 0.1), "takes a law without friction"),
        (lambda: Scattered(Coulomb(Moreau(0.5)), 0.1), "friction goes around it"),
        (lambda: Scattered(Routh(0.5), 0.1), "takes a law without friction, got Routh"),
        (lambda: Scattered(Moreau(0.5), -1.0), "variance must be 0 or more"),
        (lambda: Scattered(Moreau(0.5), [[1.0, 2.0], [2.0, 1.0]]), "positive semidefinite"),
        (lambda: Scattered(Moreau(0.5), [[1.0, 0.5], [0.0, 1.0]]), "symmetric"),
        (lambda: Scattered(Moreau(0.5), 0.1, seed=-1), "seed must be 0 or more"),
        (lambda: Scattered(Moreau(0.5), np.eye(3)).resolve(launched(3, 1)), "3, 3.* but 2 contacts"),
        (lambda: Scattered(Moreau(0.5), "wide"), "variance must be 0 or more, and finite, got 'wide'"),
    ],
)
def test_wrong_numbers(make, message):
    with pytest.raises(RestitutionError, match=message):
        make()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e6])
def test_covariances_of_any_size_are_judged_alike(scale):
    """Rounding leaves eigenvalues of ``A A^T`` slightly below 0."""
    A = np.random.default_rng(0).normal(size=(6, 2))
    Scattered(Moreau(0.5), scale * A @ A.T)
    with pytest.raises(RestitutionError, match="positive semidefinite"):
        Scattered(Moreau(0.5), scale * np.diag([1.0, -0.1]))
