"""A law whose outcome is a random point of S(v-): its range and distribution, and repeatable runs."""

import subprocess
import sys

import numpy as np
import pytest
import scipy.stats
from problems import PROBLEMS, launched, rod
from scenes import compiled, run

from impactlaw import AdmissibleSet, AnyOutcome, Collision, Coulomb, Friction, Scattered, Stepper, make_law
from impactlaw.errors import RestitutionError
from impactlaw.models import load


def outcomes(collision, n, law=AnyOutcome):
    return np.array([law(seed=seed).resolve(collision).post_velocity for seed in range(n)])


def test_one_contact_has_a_uniform_coefficient():
    c = Collision(np.diag([1.0, 3.0]), [[1.0, -2.0]], [-1.0, 0.5])
    e = [AnyOutcome(seed=s).resolve(c).post_contact_velocity[0] / -c.pre_contact_velocity[0] for s in range(1000)]
    assert scipy.stats.kstest(e, "uniform").pvalue > 0.01


@pytest.mark.parametrize("collision", [launched(3, 1), launched(5, 2), rod()], ids=["three", "five", "rod"])
def test_outcomes_are_in_the_admissible_set_and_spread_as_its_samples(collision):
    found, S = outcomes(collision, 150), collision.admissible_set
    assert all(S.contains(v, 1e-9) for v in found)
    for column, wanted in zip(found.T, S.sample(3000, 0).T, strict=True):
        assert scipy.stats.ks_2samp(column, wanted).pvalue > 1e-3


def test_the_impulses_are_those_of_the_outcome():
    """The impulses reach v+ exactly, as the certificate shows."""
    impact = AnyOutcome(seed=3).resolve(launched(4, 1))
    assert impact.residual < 1e-9
    assert (impact.impulse >= 0.0).all()


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem_has_an_outcome_that_is_possible(name):
    c = PROBLEMS[name]()
    for seed in range(3):
        impact = AnyOutcome(seed=seed).resolve(c)
        assert impact.violations.is_admissible(1e-7)
        assert impact.residual < 1e-9


def test_equality_constraints_keep_their_velocity():
    c = Collision(
        np.eye(4), [[-1, 1, 0, 0], [0, -1, 1, 0]], [1.0, 0.2, 0.0, 0.0], bilateral_jacobian=[[0.0, 0.0, 1.0, -1.0]]
    )
    impact = AnyOutcome(seed=1).resolve(c)
    assert impact.violations.is_admissible(1e-9)
    assert impact.post_velocity[2] == pytest.approx(impact.post_velocity[3])


def test_the_same_collision_has_the_same_outcome_in_every_process():
    code = (
        "from impactlaw import AnyOutcome, Collision; import numpy as np; c = Collision(np.eye(3), "
        "[[-1, 1, 0], [0, -1, 1]], [1, 0, 0]); print(AnyOutcome(seed=7).resolve(c).post_velocity.tolist())"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    c = Collision(np.eye(3), [[-1, 1, 0], [0, -1, 1]], [1, 0, 0])
    assert told.strip() == str(AnyOutcome(seed=7).resolve(c).post_velocity.tolist())
    assert told.strip() != str(AnyOutcome(seed=8).resolve(c).post_velocity.tolist())


@pytest.mark.parametrize(("h", "nv", "sampled"), [(64, 128, False), (40, 18, False), (17, 12, False), (16, 12, True)])
def test_many_contacts_have_an_outcome_without_samples_of_s(h, nv, sampled, monkeypatch):
    """Where S would take too long, the outcome is that of one of Poisson's laws, which lies in S as well."""
    rng, asked, sample = np.random.default_rng(0), [], AdmissibleSet.sample
    monkeypatch.setattr(AdmissibleSet, "sample", lambda S, n, rng: (asked.append(n), sample(S, n, rng))[1])
    J, v = rng.normal(size=(h, nv)), rng.normal(size=nv)
    J[J @ v > 0] *= -1.0
    c = Collision(np.eye(nv), J, v)
    one, other = outcomes(c, 2)
    assert bool(asked) == sampled
    assert np.abs(one - other).max() > 1e-3
    assert AnyOutcome().resolve(c).violations.is_admissible(1e-8)


def test_surfaces_that_move_against_each_other_have_an_outcome():
    c = Collision([[1.0]], [[1.0], [-1.0]], [-1.0], surface_velocity=[0.3, 0.2])
    assert not c.has_admissible_set
    impact = AnyOutcome(seed=1).resolve(c)
    assert 0.0 < impact.post_contact_velocity[0] < 0.5
    assert (impact.post_contact_velocity >= -1e-9).all()


def test_friction_is_coulombs_and_creates_no_energy():
    c = Collision(np.eye(2), [[0.0, 1.0]], [3.0, -2.0], friction=Friction([[1.0, 0.0]], [0], [0.5]))
    plain = AnyOutcome(seed=5).resolve(Collision(np.eye(2), [[0.0, 1.0]], [3.0, -2.0]))
    impact = Coulomb(AnyOutcome(seed=5)).resolve(c)
    assert impact.post_contact_velocity == pytest.approx(plain.post_contact_velocity)
    assert impact.post_velocity[0] == pytest.approx(3.0 - 0.5 * impact.impulse[0])
    assert impact.energy_change <= 0.0


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
def test_in_every_way_to_step(options):
    """The outcomes of a run lie in S, differ between seeds, and repeat with the same seed."""

    def collisions(seed):
        model, data = load("newtons_cradle")
        stepper = Stepper(model, AnyOutcome(seed=seed), **options)
        events = run(stepper, data, round(1.5 / model.opt.timestep))
        assert all(event.impact.violations.is_admissible(1e-8) for event in events)
        return events, data.qpos.copy()

    one, place = collisions(1)
    assert len(one) > 0
    assert (collisions(1)[1] == place).all()
    assert np.abs(collisions(2)[1] - place).max() > 1e-3
    assert one[0].impact.energy_change < -1e-9


def test_time_steps_reach_the_outcome_drawn():
    """Without gravity, the velocity after the step in which the balls meet is the one drawn from S."""
    body = '<body pos="{} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1" condim="1"/></body>'
    model, data = compiled("".join(body.format(0.2 * i - 1e-3 * (i == 0)) for i in range(3)), option='gravity="0 0 0"')
    data.qvel[0] = 1.0
    stepper = Stepper(model, AnyOutcome(seed=2), scheme="time-stepping")
    events = run(stepper, data, 2)
    impact = events[0].impact
    drawn = AnyOutcome(seed=2).resolve(impact.collision).post_velocity
    np.testing.assert_allclose(data.qvel, drawn, atol=1e-8)
    assert np.abs(drawn - Collision(np.eye(3), [[-1, 1, 0], [0, -1, 1]], [1, 0, 0]).pre_velocity).max() > 1e-3


def test_a_law_has_the_seed_of_an_episode_unless_it_has_its_own():
    for law in (AnyOutcome, lambda **options: Scattered(make_law("moreau", 0.5), 0.1, **options)):
        assert law().seeded(4).seed == 4
        assert law(seed=3).seeded(4).seed == 3
        assert Coulomb(law()).seeded(4).law.seed == 4
    moreau = make_law("moreau", 0.5)
    assert moreau.seeded(4) is moreau


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: AnyOutcome(seed=-1), "seed must be 0 or more"),
        (lambda: AnyOutcome(seed=0.5), "seed must be a whole number"),
        (lambda: make_law("any-outcome", 0.5), "takes no restitution"),
    ],
)
def test_wrong_numbers(make, message):
    with pytest.raises(RestitutionError, match=message):
        make()


def test_a_zero_has_no_sign():
    one, other = (Collision(np.eye(2), [[1.0, zero], [0.0, 1.0]], [-1.0, -1.0]) for zero in (0.0, -0.0))
    np.testing.assert_array_equal(AnyOutcome().resolve(one).post_velocity, AnyOutcome().resolve(other).post_velocity)


def test_the_law_in_the_middle_gets_the_seed_too():
    law = Scattered(AnyOutcome(), 0.1).seeded(5)
    assert law.seed == law.law.seed == 5
