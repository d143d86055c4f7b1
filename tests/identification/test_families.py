"""Laws with few parameters: fitted again, confidence intervals, drops of an ellipse, chains of springs."""

import sys
from io import StringIO

import numpy as np
import pytest
from identification.known import open_collisions
from laws.frictional import one_contact
from problems import balls, launched

from impactlaw import Collision, Compliant, Coulomb, Fremond, Moreau, Newton, Poisson, Routh
from impactlaw.errors import MeasurementError, UnknownNameError
from impactlaw.identification import FAMILIES, audit, cross_validate, fit, searching
from impactlaw.identification.families import Family, with_friction
from scripts.identification import chains, drops


def chain_collisions(n, seed=0, masses=(1.0, 2.0, 1.5)):
    rng = np.random.default_rng(seed)
    made = [balls(masses, np.sort(rng.normal(size=len(masses)))[::-1]) for _ in range(n)]
    return [Collision(c.mass_matrix, c.jacobian, c.pre_velocity, labels=("a/b", "b/c")) for c in made]


@pytest.mark.parametrize(
    ("family", "law", "expected"),
    [
        ("moreau", Moreau(0.7), {"restitution": 0.7}),
        ("newton", Newton({"a/b": 0.3, "b/c": 0.8}), {"restitution a/b": 0.3, "restitution b/c": 0.8}),
        ("poisson", Poisson({"a/b": 0.3, "b/c": 0.8}), {"restitution a/b": 0.3, "restitution b/c": 0.8}),
        ("reversal", Fremond.reversal(0.6), {"restitution": 0.6}),
        ("moreau", Moreau(1.0), {"restitution": 1.0}),
        (
            "compliant",
            Compliant({"a/b": 1.0, "b/c": 2.0}, exponent=1.8, restitution=0.9),
            {"restitution": 0.9, "exponent": 1.8, "log stiffness b/c over a/b": np.log(2.0)},
        ),
    ],
)
def test_found_again(family, law, expected):
    collisions = chain_collisions(12)
    found = fit(collisions, [law.resolve(c).post_velocity for c in collisions], family)
    assert found.family == family
    assert found.parameters == pytest.approx(expected, abs=1e-6)
    assert found.rms < 1e-7
    assert found.rank == len(expected)
    assert found.certificate <= 1 + 1e-9 or family == "newton"
    for c in collisions:
        np.testing.assert_allclose(found.law.resolve(c).post_velocity, law.resolve(c).post_velocity, atol=1e-6)


@pytest.mark.parametrize(("family", "law"), [("coulomb", Coulomb(Newton(0.6))), ("routh", Routh(0.6))])
def test_friction_found_again(family, law):
    collisions = [with_friction(one_contact(np.random.default_rng([1, i])), 0.3) for i in range(40)]
    after = [law.resolve(c).post_velocity for c in collisions]
    given = [with_friction(c, 1.0) for c in collisions]
    found = fit(given, after, family)
    assert found.parameters == pytest.approx({"restitution": 0.6, "friction": 0.3}, abs=1e-5)
    assert found.rank == 2
    assert found.certificate <= 1 + 1e-9
    np.testing.assert_allclose(np.concatenate(found.predict(given)), np.concatenate(after), atol=1e-3)
    with pytest.raises(MeasurementError, match="the collision of 0, 1 has no tangential directions"):
        found.predict([balls((1.0, 1.0, 1.0), (1.0, 0.0, 0.0))])


def test_intervals_cover():
    """With equal relative errors everywhere, 95 % intervals contain the true value in 90 to 98 % of cases."""
    collisions, hits = chain_collisions(40, 3), 0
    clean = [Newton([0.4, 0.7]).resolve(c).post_velocity for c in collisions]
    for seed in range(150):
        rng = np.random.default_rng([2, seed])
        noisy = [
            v + 0.03 * c.pre_speed * rng.normal(size=3) / np.sqrt(np.diag(c.mass_matrix))
            for c, v in zip(collisions, clean, strict=True)
        ]
        found = fit(collisions, noisy, "newton")
        for truth, (low, high) in zip((0.4, 0.7), found.confidence.values(), strict=True):
            hits += low <= truth <= high
    assert 0.90 <= hits / 300 <= 0.98


@pytest.mark.parametrize("few", [2, 3])
def test_intervals_cover_a_contact_that_few_collisions_tell(few):
    """Ten other collisions carry no information about its coefficient."""
    hits, law = 0, Newton({"a/b": 0.4, "b/c": 0.7})
    for seed in range(100):
        rng = np.random.default_rng([12, seed])
        labels = ["a/b"] * 10 + ["b/c"] * few
        cs = [Collision(np.eye(2), [[-1.0, 1.0]], [rng.uniform(0.5, 2.0), 0.0], labels=(name,)) for name in labels]
        after = [law.resolve(c).post_velocity + 0.03 * c.pre_speed * rng.normal(size=2) for c in cs]
        low, high = fit(cs, after, "newton").confidence["restitution b/c"]
        hits += low <= 0.7 <= high
    assert hits >= 90


def test_one_collision_tells_no_interval():
    rng, law = np.random.default_rng(13), Newton({"a/b": 0.4, "b/c": 0.7})
    cs = [Collision(np.eye(2), [[-1.0, 1.0]], [1.0, 0.0], labels=(name,)) for name in ["a/b"] * 10 + ["b/c"]]
    after = [law.resolve(c).post_velocity + 0.03 * rng.normal(size=2) for c in cs]
    found = fit(cs, after, "newton").confidence
    assert np.isnan(found["restitution b/c"]).all()
    assert found["restitution a/b"][0] < 0.4 < found["restitution a/b"][1]


@pytest.mark.parametrize(("family", "law"), [("newton", Newton), ("poisson", Poisson)])
def test_many_contacts_have_a_coefficient_each(family, law):
    """Forty contacts with two starting values each: all combinations would be 10^12."""
    truth = np.linspace(0.2, 0.9, 40)
    labels = tuple(f"b{i}/floor" for i in range(40))
    cs = [Collision(np.eye(40), np.eye(40), -1.0 - 0.1 * (np.arange(40) + k) % 3, labels=labels) for k in range(2)]
    after = [law(truth).resolve(c).post_velocity for c in cs]
    found = fit(cs, after, family)
    np.testing.assert_allclose(list(found.parameters.values()), truth, rtol=0, atol=1e-6)


def test_the_centre_of_mass_flatters_no_law():
    collisions = chain_collisions(5)
    after = [Moreau(0.5).resolve(c).post_velocity for c in collisions]
    fast = [Collision(c.mass_matrix, c.jacobian, c.pre_velocity + 100.0, labels=c.labels) for c in collisions]
    one = fit(collisions, after, "reversal").residuals
    two = fit(fast, [v + 100.0 for v in after], "reversal").residuals
    np.testing.assert_allclose(one, two, rtol=1e-6)


def test_drops_are_told_apart():
    """A twelfth of the drops; the page has all of them."""
    found = drops.measure(every=12, folds=3, families=("coulomb", "routh"))
    assert found.held_out["coulomb"].rms < 0.122
    assert found.held_out["routh"].rms < 0.109
    assert found.held_out["routh"].rms < found.held_out["coulomb"].rms
    assert found.fits["coulomb"].parameters["restitution"] == pytest.approx(0.532, abs=0.01)
    assert found.fits["coulomb"].parameters["friction"] == pytest.approx(0.192, abs=0.008)
    assert np.median(found.filed.kinetic) > 10 * np.median(found.corrected.momentum)


def test_the_audit_finds_the_sign():
    filed = audit(*drops.read_drops(corrected=False, every=3))
    assert filed.admissible < 0.3
    first = filed.likely_causes[0]
    assert first.name in ("sign of entry 0 of the tangential rows", "sign of entry 2 of the tangential rows")
    assert first.better > 0.96
    assert first.better_of_bad > 0.99
    assert first.after < 0.03 < 0.25 < first.before
    corrected = audit(*drops.read_drops(every=3))
    assert corrected.admissible > 0.95
    assert corrected.likely_causes == ()


def test_the_audit_finds_an_inertia():
    rng = np.random.default_rng(4)
    true, wrong = np.diag([1.0, 1.0, 0.4]), np.diag([1.0, 1.0, 1.2])
    collisions, after = [], []
    for _ in range(40):
        v = np.array([rng.normal(), -1.0, 3 * rng.normal()])
        J = [[0.0, 1.0, rng.normal()]]
        after.append(Newton(0.5).resolve(Collision(true, J, v)).post_velocity)
        collisions.append(Collision(wrong, J, v))
    causes = {cause.name: cause.value for cause in audit(collisions, after).likely_causes}
    assert causes["inertia 2 times"] == pytest.approx(1 / 3, rel=1e-3)
    assert causes["inertia 1 times"] == pytest.approx(3.0, rel=1e-3)  # only the ratio can be identified


def test_hertzian_chains():
    found = {(one.balls, one.equal): one for one in chains.study_chains(n=120)}
    np.testing.assert_allclose(found[3, True].launched, (-0.0710, 0.0764, 0.9945), rtol=0, atol=1e-3)
    np.testing.assert_allclose(found[5, True].launched, (-0.071, -0.030, -0.015, 0.127, 0.989), rtol=0, atol=1e-3)
    for n, limit in ((3, 0.03), (4, 0.05), (5, 0.05)):
        errors = found[n, True].errors
        assert errors["full E"] <= limit
        assert errors["full E"] < errors["reversal"] < 0.2 < errors["Newton"] <= errors["Moreau"] * 1.01
    assert all(one.E.certificate <= 1 + 1e-12 for one in found.values())


def test_paths_go_between_corners():
    paths = chains.paths()
    assert (np.diff(paths["stiffness ratio"][:, 0]) > 0).all()
    assert (np.diff(paths["exponent"][:, 1]) > 0).all()
    np.testing.assert_allclose(paths["stiffness ratio"][0], (0.0, 1.0), atol=1e-4)
    np.testing.assert_allclose(paths["stiffness ratio"][-1], (1.0, 0.0), atol=5e-3)


def test_every_family_or_a_reason():
    """A new family in the registry is tested here automatically."""
    frictionless, frictional = chain_collisions(10), [one_contact(np.random.default_rng([5, i])) for i in range(10)]
    for name in FAMILIES:
        fitted = 0
        for collisions in (frictionless, frictional):
            after = [c.pre_velocity * 1.0 for c in collisions]
            after = [Moreau(0.5).resolve(c).post_velocity for c in collisions]
            try:
                found = fit(collisions, after, name)
            except MeasurementError:
                continue
            fitted += 1
            assert set(found.parameters) == set(found.confidence)
            assert found.residuals.shape == (10,)
            assert cross_validate(collisions, after, name, folds=2).rms >= 0
        assert fitted


@pytest.mark.parametrize("family", ["coulomb", "routh"])
def test_projection_onto_s_is_not_for_laws_with_friction(family):
    collisions = [one_contact(np.random.default_rng([5, i])) for i in range(10)]
    after = [Moreau(0.5).resolve(c).post_velocity for c in collisions]
    for use in (fit, cross_validate):
        with pytest.raises(MeasurementError, match=f"leaves out the friction that family '{family}'"):
            use(collisions, after, family, projected=True)


def test_refusals():
    collisions = [launched(3, 1)] * 2
    after = [np.zeros(3)] * 2
    with pytest.raises(UnknownNameError, match="did you mean 'newton'"):
        fit(collisions, after, "newtons")
    with pytest.raises(MeasurementError, match="cannot be split into 'all' folds"):
        cross_validate([launched(3, 1)] * 2, [[0.0, 0.0, 1.0]] * 2, folds="all")
    with pytest.raises(MeasurementError, match="no collisions"):
        fit([], [], "newton")
    for no_list in ((None, after), (collisions, None)):
        with pytest.raises(MeasurementError, match="must be a list with an entry for each collision, got None"):
            fit(*no_list)
    with pytest.raises(MeasurementError, match="2 collisions, but 1 velocities"):
        fit(collisions, after[:1], "newton")
    with pytest.raises(MeasurementError, match="velocity after collision 1 must be 3 finite numbers, got"):
        fit(collisions, [np.zeros(3), np.full(3, np.nan)], "newton")
    with pytest.raises(MeasurementError, match="needs tangential directions"):
        fit(collisions, after, "routh")
    with pytest.raises(MeasurementError, match="no motion of its contacts"):
        fit([balls(np.ones(3), np.ones(3))], after[:1], "newton")
    _, collisions, after = open_collisions(2, 4, 0)
    with pytest.raises(MeasurementError, match=r"must be impactlaw\.Collision"):
        fit([1, 2, 3, 4], after, "newton")


@pytest.mark.parametrize("ratio", [7.0, -7.0])
def test_springs_of_very_different_stiffness_are_found(ratio):
    """The search has local minima: started from equal stiffness only, it ends in one of them."""
    rng = np.random.default_rng(0)
    law = Compliant({"a": 1.0, "b": float(np.exp(ratio))}, restitution=0.9)
    collisions = []
    for _ in range(30):
        mass = np.diag(rng.uniform(0.5, 2.0, 3))
        velocity = np.sort(rng.normal(size=3))[::-1]
        collisions.append(Collision(mass, [[-1, 1, 0], [0, -1, 1]], velocity, labels=("a", "b")))
    found = fit(collisions, [law.resolve(c).post_velocity for c in collisions], family="compliant")
    assert found.parameters["log stiffness b over a"] == pytest.approx(ratio, abs=1e-6)
    assert found.parameters["exponent"] == pytest.approx(1.5, abs=1e-6)


def test_a_family_with_local_minima_takes_few_trials_and_tells_them(monkeypatch):
    """Each trial integrates all collisions in time, which takes minutes where springs give little back."""
    trials, shown, predicted = [], StringIO(), Family.predicted
    shown.isatty = lambda: True
    monkeypatch.setattr(searching, "SOON", 0.0)
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(Family, "predicted", lambda *given: trials.append(given[-1]) or predicted(*given))
    collisions = chain_collisions(10, masses=(1.0, 1.0, 1.0))
    found = fit(collisions, [Moreau(0.5).resolve(c).post_velocity for c in collisions], "compliant")
    assert len(trials) < 300  # 419 where each of four searches is followed to its end
    assert found.rms == pytest.approx(0.0463514822, rel=1e-7)  # as found by them
    assert "fitting compliant" in shown.getvalue()
