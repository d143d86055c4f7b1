"""The solvers: certified answers on random problems of every kind, and each solver by its name."""

import re
import warnings

import numpy as np
import pytest
from certificates import assert_certified, exact_velocity, is_ray, wanted, whitened_gradients
from problems import LAWS, PROBLEMS, launched, random_collision

from impactlaw import Collision, Fremond, LinearMap, MaximalDissipation, Moreau, Newton
from impactlaw.errors import SolverError, UnknownNameError, UnsolvableLawError
from impactlaw.solvers import SOLVERS, Problem, Status
from impactlaw.solvers.methods.osqp import osqp
from impactlaw.solvers.methods.projected_gauss_seidel import projected_gauss_seidel

BATCHES = range(10)
BATCH = 200  # random collisions per batch, for each kind of law


def batch(seed):
    for i in range(BATCH):
        rng = np.random.default_rng([41, seed, i])
        yield rng, random_collision(rng)


# --- random problems -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", BATCHES)
def test_moreau_is_a_half_line(seed):
    """v+ = (1 + e) p - e v- with the point p of maximal dissipation; both are certified, and neither adds energy.

    To 1e-9, and to the effect of rounding of the gradients on v+ if those with impulses are nearly dependent.
    """
    tolerances = []
    for rng, c in batch(seed):
        e = rng.uniform()
        p, impact = MaximalDissipation().resolve(c), Moreau(e).resolve(c)
        assert_certified(p, MaximalDissipation())
        assert_certified(impact, Moreau(e))
        expected = (1 + e) * p.post_velocity - e * c.pre_velocity
        carrying = (whitened_gradients(c) / c.gradient_norms[:, None])[impact.impulse > 0]
        singular = np.linalg.svd(carrying, compute_uv=False)
        independence = singular[singular > 1e-15 * singular.max(initial=0.0)].min(initial=1.0)
        tolerances.append(1e-9 + 1e-14 / independence)
        assert c.metric.norm(impact.post_velocity - expected) <= tolerances[-1] * c.pre_speed
        assert impact.energy_change <= 1e-9 * c.pre_speed**2
    assert np.quantile(tolerances, 0.8) < 1e-6


@pytest.mark.parametrize("kind", ["newton", "fremond"])
@pytest.mark.parametrize("seed", BATCHES)
def test_general_restitution_is_certified_or_proved_unsolvable(seed, kind):
    unsolvable = 0
    for rng, c in batch(seed):
        h = len(c.labels)
        law = Newton(rng.uniform(size=h).tolist()) if kind == "newton" else Fremond(rng.normal(size=(h, h)))
        try:
            impact = law.resolve(c)
        except UnsolvableLawError as error:
            unsolvable += 1
            proof = error
        else:
            assert_certified(impact, law)
            if kind == "newton" and (c.pre_contact_velocity <= 0).all():
                assert not impact.has_distant_effect
                assert impact.violations.energetic <= 1e-9 * c.pre_speed
            continue
        assert is_ray(proof.ray, c, law)
        assert proof.contacts == tuple(np.array(c.labels)[proof.ray > 0])
    assert 0 < unsolvable < BATCH / 2


@pytest.mark.parametrize("seed", BATCHES)
def test_linear_map(seed):
    for rng, c in batch(seed):
        nv = len(c.pre_velocity)
        law = LinearMap(rng.normal(size=(nv, nv)))
        assert_certified(law.resolve(c), law)


@pytest.mark.parametrize("seed", range(60))
def test_velocity_of_random_laws_agrees_with_rational_arithmetic(seed):
    """Independent gradients, masses over twelve orders of magnitude, four contacts."""
    rng = np.random.default_rng([42, seed])
    c = Collision(np.diag(10.0 ** rng.uniform(-6, 6, 6)), rng.normal(size=(4, 6)), rng.normal(size=6))
    for law in (Moreau(rng.uniform()), Newton(rng.uniform(size=4).tolist()), Fremond(rng.normal(size=(4, 4)))):
        impact = law.resolve(c)
        exact = exact_velocity(c, wanted(law, c))
        assert c.metric.norm(impact.post_velocity - exact) <= 1e-9 * max(c.pre_speed, c.metric.norm(exact))


@pytest.mark.parametrize("slow", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("law_name", LAWS)
def test_slow_contact_of_a_fast_system(law_name, slow):
    """A box slides fast and settles slowly: its settling velocity is resolved to its own digits."""
    c = PROBLEMS["box on its corners"]()
    slid = Collision(c.mass_matrix, c.jacobian, [1.0, 0.0, -slow, 0.0, 0.0, 0.0])
    law = LAWS[law_name](slid)
    impact = law.resolve(slid)
    assert_certified(impact, law)
    if law_name not in ("linear map", "newton of speed"):  # these are not homogeneous in the settling speed
        alone = Collision(c.mass_matrix, c.jacobian, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
        settled = law.resolve(alone).post_velocity
        np.testing.assert_allclose(impact.post_velocity[2:], slow * settled[2:], rtol=0, atol=1e-6 * slow + 1e-14)


@pytest.mark.parametrize("fixed", [0, 1])
def test_conflict_within_rounding_is_no_conflict(fixed):
    """Two copies of a gradient and its opposite close with the rounding error of a speed of 1; also with a zero row."""
    J = [[0.0, 1.0], [0.0, 1.0], [0.0, -1.0]] + [[0.0, 0.0]] * fixed
    c = Collision(np.eye(2), J, [1.0, -1e-16])
    law = Newton([1.0, 0.2, 0.0] + [0.5] * fixed)
    assert_certified(law.resolve(c), law)
    with pytest.raises(UnsolvableLawError):
        law.resolve(Collision(c.mass_matrix, J, [1.0, -1e-6]))


@pytest.mark.parametrize("seed", [24626, 392891, 397219])
def test_rank_that_is_rounding(seed):
    """In about 1 of 50 000 random collisions, solvers may take rounding of the gradients for independent directions."""
    c = random_collision(np.random.default_rng([45, seed]))
    law = LinearMap(-np.diag(np.linspace(0, 1, len(c.pre_velocity)))) if seed == 397219 else Moreau(0.5)
    assert_certified(law.resolve(c), law)


@pytest.mark.parametrize("angle", [1e-2, 1e-5, 1e-8])
def test_jammed_wedge(angle):
    """Impulses of 1/angle nearly cancel: v+ keeps its digits although Lambda cannot be rounded that finely."""
    c = Collision(np.eye(2), [[1.0, angle], [-1.0, angle]], [0.0, -1.0])
    impact = Moreau(0.5).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(impact.impulse * angle, [0.75, 0.75], rtol=1e-9)
    assert impact.residual < 1e-9


@pytest.mark.parametrize("exponent", range(-17, -7))
def test_jammed_beyond_double_precision_is_certified_or_refused(exponent):
    """Gradients are opposite to within rounding: impulses of any size cancel, and no answer may be invented."""
    for i in range(30):
        rng = np.random.default_rng([46, -exponent, i])
        h, nv = int(rng.integers(2, 30)), int(rng.integers(2, 15))
        J = rng.normal(size=(1, nv)) + 10.0**exponent * rng.normal(size=(h, nv))
        c = Collision(np.eye(nv), J * rng.choice([-1.0, 1.0], size=(h, 1)), rng.normal(size=nv))
        law = Moreau(rng.uniform())
        try:
            impact = law.resolve(c)
        except SolverError:
            continue
        assert_certified(impact, law)


# --- each solver by name ---------------------------------------------------------------------------------------------


NOT_OF_A_VELOCITY = [
    "box on its corners",
    "box on 64 points",
    "tilted box",
    "duplicated contacts",
    "nearly parallel contacts",
]


def refuses(solver, law_name, problem_name, collides):
    """Return whether a solver refuses a problem.

    Closed form refuses more than one contact; NNLS contact velocities that no velocity has; the dual active set
    gradients so dependent, 1e-6, that it sees no solution; primal-dual a G that is singular to 1e-14.
    """
    if solver == "closed-form":
        return collides and problem_name not in ["one contact", "contact that cannot move"]
    if solver == "nnls":
        return law_name == "fremond full" and problem_name in NOT_OF_A_VELOCITY
    if solver == "primal-dual-active-set":
        return problem_name == "nearly parallel contacts" and law_name in ["moreau 0.5", "newton scalar"]
    return solver == "dual-active-set" and problem_name == "heavy ball hits light ones" and law_name != "linear map"


ITERATIVE = ["osqp", "projected-gauss-seidel"]


def converges(law, c, solver) -> bool:
    """Return whether an iterative solver converges; otherwise check that it reports how far it came."""
    try:
        law.resolve(c, solver=solver)
    except SolverError as error:
        refusal = str(error)
    else:
        return True
    assert re.search(r"reached .* \(status \w+, \d+ iterations, residual \d", refusal)
    return False


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("problem_name", [name for name in PROBLEMS if name != "ball between two walls"])
@pytest.mark.parametrize("law_name", ["moreau 0.5", "newton scalar", "fremond full", "linear map"])
def test_every_solver_agrees_with_auto_or_says_that_it_cannot(solver, problem_name, law_name):
    c = PROBLEMS[problem_name]()
    law = LAWS[law_name](c)
    if (law_name, problem_name) == ("fremond full", "rank deficient"):
        with pytest.raises(UnsolvableLawError):
            law.resolve(c, solver=solver)
        return
    auto = law.resolve(c)
    if solver in ITERATIVE and not converges(law, c, solver):
        return
    if refuses(solver, law_name, problem_name, collides=auto.impulse.any()):
        with pytest.raises(SolverError, match=rf"solver '{solver}' reached no answer on \d+ contacts"):
            law.resolve(c, solver=solver)
        return
    forced = law.resolve(c, solver=solver)
    assert_certified(forced, law)
    speed = max(c.pre_speed, c.metric.norm(auto.post_velocity))
    assert c.metric.norm(forced.post_velocity - auto.post_velocity) <= 1e-8 * speed


@pytest.mark.parametrize("solver", [*SOLVERS, "auto"])
def test_one_contact(solver):
    impact = Moreau(0.25).resolve(PROBLEMS["one contact"](), solver=solver)
    np.testing.assert_allclose(impact.post_velocity, [0.75], rtol=1e-14)
    np.testing.assert_allclose(impact.impulse, [7.5], rtol=1e-14)


@pytest.mark.parametrize("c", [launched(3, 1), launched(2, 1), PROBLEMS["no contact"]()])
def test_unknown_solver(c):
    with pytest.raises(UnknownNameError, match="unknown solver 'nnsl'; did you mean 'nnls'"):
        Moreau(0.5).resolve(c, solver="nnsl")


@pytest.mark.parametrize("solver", ITERATIVE)
@pytest.mark.parametrize("problem_name", ["three balls", "rod", "box on its corners", "chain of 64", "random dense"])
def test_iterative_solvers_converge_where_it_is_easy(solver, problem_name):
    c = PROBLEMS[problem_name]()
    assert converges(Moreau(0.5), c, solver)


def test_iterative_solvers_at_loose_accuracy():
    """More sweeps or a smaller tolerance reduce the error; status and residual report it."""
    c = launched(20, 1)
    problem = Problem(c.whitened_jacobian, -1.5 * c.pre_contact_velocity, -1.5 * c.whitened_velocity)
    exact = Moreau(0.5).resolve(c).impulse
    errors = []
    for sweeps in (10, 100, 1000):
        solution = projected_gauss_seidel(problem, sweeps=sweeps)
        errors.append(np.abs(solution.impulse - exact).max())
        assert solution.residual <= errors[-1]
        assert (solution.status is Status.STOPPED) == (solution.residual > 1e-10)
        assert solution.iterations <= sweeps
    assert errors[0] > 10 * errors[1] > 1000 * errors[2]
    loose, tight = (osqp(problem, tolerance=tolerance, polish=False) for tolerance in (1e-3, 1e-9))
    assert tight.residual < 0.1 * loose.residual
    assert tight.residual < 1e-8
    assert osqp(problem, iterations=1).status is Status.STOPPED


@pytest.mark.parametrize("solver", SOLVERS)
def test_solvers_never_raise(solver):
    """Unsolvable, empty, opening and zero problems give a status, not an exception or a warning."""
    opposite = np.array([[1.0, 0.0], [-1.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        unsolvable = SOLVERS[solver](Problem(opposite, np.array([1.0, 0.0])))
        assert unsolvable.status is not Status.SOLVED
        assert not unsolvable.impulse.any() or solver == "projected-gauss-seidel"
        assert SOLVERS[solver](Problem(opposite, np.array([-1.0, -2.0]))).impulse.tolist() == [0.0, 0.0]
        assert SOLVERS[solver](Problem(np.eye(1), np.array([0.0]))).impulse.tolist() == [0.0]
