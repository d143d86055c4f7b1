"""An impact: its characteristic entities, its certificate, and the audit of outcomes from elsewhere."""

import numpy as np
import pytest
from problems import LAWS, PROBLEMS, SWAPPED, balls, box, energy, launched, rod

from impactlaw import Collision, Fremond, FrictionImpact, Impact, MaximalDissipation, Moreau, Newton
from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.admissible.violations import Violations

EXACT = {"rtol": 0, "atol": 1e-12}


def test_entities_of_the_real_cradle():
    """Three balls, (1, 0, 0) -> (0, 0, 1); the second contact opens with energy from the first one."""
    impact = Fremond(SWAPPED).resolve(launched(3, 1))
    np.testing.assert_allclose(impact.post_contact_velocity, [0, 1], **EXACT)
    np.testing.assert_allclose(impact.mean_contact_velocity, [-0.5, 0.5], **EXACT)
    assert impact.intensity == pytest.approx(np.sqrt(2), abs=1e-12)
    np.testing.assert_allclose(impact.topology, [0.5, 0.5], **EXACT)
    np.testing.assert_allclose(impact.induced_gradient, [-0.5, 0, 0.5], **EXACT)
    assert impact.induced_impulse == pytest.approx(2.0, abs=1e-12)
    assert impact.energy_change == pytest.approx(0.0, abs=1e-12)
    assert impact.antidissipative.tolist() == [False, True]
    assert impact.has_distant_effect
    assert impact.violations.is_admissible()


def test_maximal_dissipation_has_no_distant_effect():
    impact = MaximalDissipation().resolve(launched(3, 1))
    assert impact.antidissipative.tolist() == [False, False]
    assert not impact.has_distant_effect
    assert impact.intensity == pytest.approx(np.sqrt(2 / 3), abs=1e-12)
    assert impact.energy_change == pytest.approx(-1 / 3, abs=1e-12)


@pytest.mark.parametrize("problem_name", ["all separating", "zero velocity", "no contact"])
def test_nothing_happens(problem_name):
    impact = Moreau(0.7).resolve(PROBLEMS[problem_name]())
    h = len(impact.collision.labels)
    np.testing.assert_array_equal(impact.post_velocity, impact.collision.pre_velocity)
    np.testing.assert_array_equal(impact.impulse, np.zeros(h))
    np.testing.assert_array_equal(impact.topology, np.zeros(h))
    np.testing.assert_array_equal(impact.induced_gradient, np.zeros(len(impact.post_velocity)))
    assert impact.antidissipative.tolist() == [False] * h
    assert (impact.intensity, impact.induced_impulse, impact.energy_change, impact.residual) == (0, 0, 0, 0)
    assert impact.violations.is_admissible(0.0)


@pytest.mark.parametrize("problem_name", ["three balls", "rod", "box on its corners", "random dense"])
def test_residual_sees_every_kind_of_error(problem_name):
    """Relative to |v-|: errors of the velocity and of an impulse, a negative impulse, and one that does not belong."""
    good = Moreau(0.5).resolve(PROBLEMS[problem_name]())
    c = good.collision
    assert good.residual < 1e-12

    other = good.post_velocity + 1e-3 * c.pre_velocity
    assert Impact(c, other, good.impulse, good.target_contact_velocity).residual >= 0.9e-3
    more = good.impulse + 1e-3 * c.pre_speed / c.gradient_norms
    residual = Impact(c, good.post_velocity, more, good.target_contact_velocity).residual
    assert residual == pytest.approx(
        np.linalg.norm((more - good.impulse) @ c.whitened_jacobian) / c.pre_speed, rel=1e-9
    )
    lower = good.target_contact_velocity - 1e-3 * c.pre_speed * c.gradient_norms
    assert Impact(c, good.post_velocity, good.impulse, lower).residual == pytest.approx(1e-3, rel=1e-9)
    higher = good.target_contact_velocity + 1e-3 * c.pre_speed * c.gradient_norms
    assert Impact(c, good.post_velocity, good.impulse, higher).residual == pytest.approx(1e-3, rel=1e-9)


def test_residual_of_pulling():
    c = Collision([[4.0]], [[1.0]], [3.0])
    assert Impact(c, np.array([1.0]), np.array([-8.0])).residual == pytest.approx(2 / 3, abs=1e-15)


def test_residual_is_relative_to_the_faster_of_before_and_after():
    c = Collision([[1.0]], [[1.0]], [-1.0])
    impact = Impact(c, np.array([100.0]), np.array([101.0]), np.array([99.0]))
    assert impact.residual == pytest.approx(0.01, abs=1e-15)


@pytest.mark.parametrize("law_name", ["maximal dissipation", "moreau 0.5", "moreau 1", "reversal", "linear map"])
@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_round_trip(problem_name, law_name):
    c = PROBLEMS[problem_name]()
    impact = LAWS[law_name](c).resolve(c)
    seen = Impact.observed(c, impact.post_velocity)
    speed = max(c.pre_speed, np.linalg.norm(c.whitened_velocity + impact.whitened_jump))
    assert seen.residual < 1e-9
    assert seen.violations.kinetic <= 1e-9 * speed
    assert seen.target_contact_velocity is None
    np.testing.assert_array_equal(seen.post_velocity, impact.post_velocity)
    units = c.whitened_jacobian / np.maximum(c.gradient_norms, 1e-300)[:, None]
    if np.linalg.matrix_rank(units, tol=1e-4) == len(units):  # then the impulse is unique
        scaled = (seen.impulse - impact.impulse) * c.gradient_norms
        np.testing.assert_allclose(scaled, 0.0, atol=1e-9 * speed)


def test_penetration():
    """The first ball passes through the second, and a momentum of 0.2 is lost: v+ = (0.6, 0, 0.2)."""
    v = Impact.observed(launched(3, 1), [0.6, 0.0, 0.2]).violations
    # the nearest velocity without penetration is the mean for all three balls, 0.8 / 3
    assert v.kinematic == pytest.approx(np.sqrt(0.6**2 + 0.2**2 - 0.8**2 / 3), abs=1e-12)
    # impulses conserve momentum: the nearest such jump to (-0.4, 0, 0.2) lacks 0.2 along (1, 1, 1) / sqrt(3)
    assert v.kinetic == pytest.approx(0.2 / np.sqrt(3), abs=1e-12)
    assert v.energetic == 0.0
    assert not v.is_admissible()


def test_penetration_alone():
    c = launched(2, 1)
    v = Impact.observed(c, [0.75, 0.25]).violations
    assert v.kinematic == pytest.approx(0.5 / np.sqrt(2), abs=1e-12)
    assert v.kinetic == pytest.approx(0.0, abs=1e-12)
    assert v.energetic == 0.0
    assert not v.is_admissible(0.3)
    assert v.is_admissible(0.4)


def test_pulling_alone():
    """Balls that separate with 1 are slowed down to 0.5 by a contact that pulls: Lambda = -0.25."""
    c = balls([1.0, 1.0], [0.0, 1.0])
    impact = Impact.observed(c, [0.25, 0.75])
    np.testing.assert_array_equal(impact.impulse, [0.0])
    assert impact.violations.kinematic == 0.0
    assert impact.violations.kinetic == pytest.approx(0.25 * np.sqrt(2), abs=1e-12)
    assert impact.violations.energetic == 0.0


def test_energy_gain_alone():
    """Twice the elastic rebound on a floor: |v+| = 2 |v-|."""
    c = Collision([[4.0]], [[1.0]], [-3.0])
    impact = Impact.observed(c, [6.0])
    assert impact.violations.kinematic == 0.0
    assert impact.violations.kinetic == pytest.approx(0.0, abs=1e-12)
    assert impact.violations.energetic == pytest.approx(6.0, abs=1e-12)
    assert impact.energy_change == pytest.approx(0.5 * 4.0 * (36 - 9), rel=1e-14)
    np.testing.assert_allclose(impact.impulse, [36.0], **EXACT)


def test_energy_from_nowhere():
    c = Collision([[1.0]], [[1.0]], [0.0])
    violations = Impact.observed(c, [2.0]).violations
    assert violations.energetic == pytest.approx(2.0, abs=1e-15)
    assert not violations.is_admissible()


def test_a_force_that_is_no_contact():
    """A sideways kick changes the velocity of 2 kg by 0.2 m/s, which violates only the kinetic condition."""
    c = box()
    v = Moreau(0.2).resolve(c).post_velocity.copy()
    v[0] -= 0.2
    violations = Impact.observed(c, v).violations
    assert violations.kinetic == pytest.approx(np.sqrt(2.0) * 0.2, abs=1e-12)
    assert violations.kinematic == 0.0
    assert violations.energetic == 0.0


def test_hand_made_impulses_that_pull_are_measured_against_those_that_push():
    c = launched(3, 1)
    pulled = np.array([0.5, -0.25])
    impact = Impact(c, c.pre_velocity + np.linalg.solve(c.mass_matrix, c.jacobian.T @ pulled), pulled)
    # v+ = (0.5, 0.75, -0.25), the jump (-0.5, 0.75, -0.25); nearest with Lambda_2 = 0: Lambda_1 = 1.25 / 2
    assert impact.violations.kinetic == pytest.approx(np.linalg.norm([0.125, 0.125, -0.25]), abs=1e-12)
    assert impact.induced_impulse == pytest.approx(0.75, abs=1e-15)


@pytest.mark.parametrize(
    ("velocity", "message"),
    [
        ([1.0, 0.0], r"must have shape \(3,\) like pre_velocity, got \(2,\)"),
        ([[1.0, 0.0, 0.0]], r"must have shape \(3,\) like pre_velocity, got \(1, 3\)"),
        ([1.0, np.nan, 0.0], "has entries that are not finite"),
        ([1.0, 0.0, np.inf], "has entries that are not finite"),
    ],
)
def test_what_is_not_an_outcome(velocity, message):
    with pytest.raises(InvalidCollisionError, match=f"post_velocity {message}"):
        Impact.observed(launched(3, 1), velocity)


@pytest.mark.parametrize("observed", [Impact.observed, FrictionImpact.observed])
def test_outcome_of_what_is_no_collision(observed):
    with pytest.raises(InvalidCollisionError, match="this takes a Collision, got None"):
        observed(None, [1])


def test_outcome_that_is_not_numbers():
    with pytest.raises(InvalidCollisionError, match="post_velocity"):
        Impact.observed(launched(3, 1), ["a", "b", "c"])


def test_energy_of_a_small_jump_keeps_its_digits():
    """T+ - T- of a slow contact of a fast system is far below the rounding of T."""
    c = Collision(np.diag([1.0, 1.0]), [[0.0, 1.0]], [1e4, -1e-5])
    impact = Moreau(0.0).resolve(c)
    assert impact.energy_change == pytest.approx(-0.5e-10, rel=1e-12)
    assert energy(c, impact.post_velocity) - energy(c, c.pre_velocity) == 0.0


def test_rod_is_one_point_collision_on_its_induced_contact():
    impact = Newton([1.0, 0.0]).resolve(rod())
    np.testing.assert_allclose(impact.topology, [5 / 9, 4 / 9], **EXACT)
    np.testing.assert_allclose(impact.induced_gradient, [1, -1 / 9], **EXACT)
    assert impact.induced_impulse == pytest.approx(3 / 2, abs=1e-12)
    np.testing.assert_allclose(
        rod().pre_velocity + 1.5 * np.array([1.0, -1 / 9]) / [1.0, 1 / 3], impact.post_velocity, **EXACT
    )


def test_a_velocity_beyond_all_energy_is_no_small_violation():
    """Its square is infinite, and so is the violation. Regression: NaN counted as 0."""
    with np.errstate(over="ignore"):
        violations = Impact.observed(launched(3, 1), [1e200, 0.0, 0.0]).violations
    assert violations.energetic == np.inf
    assert not violations.is_admissible()


def test_violations_in_words():
    """Which conditions are violated and by how much, to two digits; up to ``1e-9 |v-|`` is rounding."""
    assert str(Violations(0.0, 0.0, 0.0, 1.0)) == "none"
    assert str(Violations(0.5, 0.0, 0.0, 1.0)) == "kinematic 0.5"
    assert str(Violations(1e-8, 2e-10, 2.0, 0.1)) == "kinematic 1e-08, kinetic 2e-10, energetic 2"
    assert str(Violations(1e-8, 2e-10, 2.0, 1.0)) == "kinematic 1e-08, energetic 2"
