"""The certificate of Poisson's law, contacts that jam, and the solver of the two phases."""

import numpy as np
import pytest
from certificates import Certificate
from problems import PROBLEMS, launched, random_collision

from impactlaw import Impact, Poisson
from impactlaw.errors import SolverError
from impactlaw.solvers import SOLVERS


@pytest.mark.parametrize("problem_name", ["three balls", "rod", "box on its corners", "random dense"])
def test_residual_sees_every_kind_of_error(problem_name):
    c = PROBLEMS[problem_name]()
    good = Poisson(0.5).resolve(c)
    assert good.residual < 1e-12

    def residual(**changed):
        values = {name: getattr(good, name) for name in ("post_velocity", "impulse", "least_impulse", "compression")}
        values |= changed
        return Impact(c, values.pop("post_velocity"), values.pop("impulse"), np.zeros(len(c.labels)), **values).residual

    assert residual() == good.residual
    first = good.compression
    assert residual(post_velocity=good.post_velocity + 1e-3 * c.pre_velocity) >= 0.9e-3
    assert residual(impulse=good.impulse + 1e-3 * c.pre_speed / c.gradient_norms) >= 0.9e-4
    assert residual(least_impulse=good.impulse + 1e-3 * c.pre_speed / c.gradient_norms) == pytest.approx(1e-3, rel=1e-9)
    wrong = Impact(c, first.post_velocity, 1.001 * first.impulse, first.target_contact_velocity)
    assert residual(compression=wrong) == pytest.approx(wrong.residual)
    assert wrong.residual > 1e-4


def test_contact_that_opens_must_not_get_more_than_its_least():
    """Both contacts get 1/10 more than their least impulse; they open faster than without it, by (1/10, 1/10)."""
    c = launched(3, 1)
    good = Poisson([0.5, 1.0]).resolve(c)
    more = good.impulse + 0.1
    v = np.array([1 - more[0], more[0] - more[1], more[1]])
    wrong = Impact(c, v, more, np.zeros(2), least_impulse=good.least_impulse, compression=good.compression)
    assert wrong.residual == pytest.approx(0.1 * np.sqrt(2.0), rel=1e-12)


def jamming(seed):
    rng = np.random.default_rng([77, seed])
    c = random_collision(rng, most=24)
    e = rng.uniform(size=len(c.labels))
    return c, Poisson((np.round(e) if rng.uniform() < 0.3 else e).tolist())


@pytest.mark.parametrize("seed", [827, 1568, 1072, 2708, 249, 623, 862, 1994, 1871, 2109])
def test_contacts_that_jam(seed):
    """Nearly opposite contacts: compression impulses are 1e8 times the speed, and different parts are returned."""
    c, law = jamming(seed)
    impact = law.resolve(c)
    assert impact.compression.impulse @ c.gradient_norms > 1e6 * c.pre_speed
    assert impact.residual < 1e-9
    certificate = Certificate(impact, law)
    assert max(certificate.momentum, certificate.complementarity) < 1e-9
    assert impact.violations.energetic < 1e-9 * c.pre_speed


@pytest.mark.parametrize("seed", [26835, 28635, 47859, 49534])
def test_contacts_that_jam_beyond_all_digits_create_no_energy(seed):
    """Impulses of 1e10 to 1e13 times the speed: their rounding could give outcomes thousands of times as fast as v-."""
    c, law = jamming(seed)
    try:
        impact = law.resolve(c)
    except SolverError:
        return
    assert impact.violations.energetic < 1e-8 * c.pre_speed


def test_random_collisions_are_certified_or_refused():
    refused = 0
    for seed in range(600):
        rng = np.random.default_rng([55, seed])
        c = random_collision(rng)
        law = Poisson(rng.uniform(size=len(c.labels)).tolist())
        try:
            impact = law.resolve(c)
        except SolverError:
            refused += 1
            continue
        assert impact.residual <= 1e-9
        assert impact.violations.energetic <= 1e-9 * c.pre_speed
    assert refused <= 6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("problem_name", ["one contact", "three balls", "rod", "five balls"])
def test_both_phases_use_the_solver_named(solver, problem_name):
    c = PROBLEMS[problem_name]()
    law = Poisson(np.linspace(0.9, 0.1, len(c.labels)).tolist())
    if solver == "closed-form" and len(c.labels) > 1:
        with pytest.raises(SolverError, match="solver 'closed-form'"):
            law.resolve(c, solver=solver)
        return
    atol = 1e-5 if solver in ("osqp", "projected-gauss-seidel") else 1e-12
    forced = law.resolve(c, solver=solver)
    np.testing.assert_allclose(forced.post_velocity, law.resolve(c).post_velocity, rtol=0, atol=atol)


def test_the_compression_uses_the_solver_named():
    """With E = 0 there is no expansion to solve, only a compression."""
    with pytest.raises(SolverError, match="solver 'closed-form'"):
        Poisson(0.0).resolve(launched(3, 1), solver="closed-form")


def test_what_nothing_penetrates_is_left_alone():
    """Rounding of contact velocities, here of contacts that end at 0, causes no impulse."""
    impact = Poisson(0.3).resolve(launched(5, 2))
    np.testing.assert_array_equal(impact.impulse, 1.3 * impact.compression.impulse)
