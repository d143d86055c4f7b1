"""Poisson's law: answers worked out by hand, what it shares with Moreau's and Newton's laws, and that it stays in S."""

import mujoco
import numpy as np
import pytest
from problems import (
    PROBLEMS,
    Certificate,
    balls,
    box,
    launched,
    least_norm_error,
    random_collision,
    rod,
    sparse_chain,
)
from scenes import compiled

from impactlaw import Collision, Impact, MaximalDissipation, Moreau, Newton, Poisson, Stepper, make_law
from impactlaw.errors import RestitutionError, SolverError, UnsolvableLawError
from impactlaw.models import load
from impactlaw.solvers import SOLVERS

EXACT = {"rtol": 0, "atol": 1e-12}


# --- by hand ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("e", "opening", "impulse"),
    [
        ((1, 1), (1, 0), (4 / 3, 2 / 3)),
        ((0, 0), (0, 0), (2 / 3, 1 / 3)),
        ((1, 0), (1, 0), (4 / 3, 2 / 3)),  # e_2 < e_1: the second contact needs as much as with e_1
        ((0.6, 0.2), (0.6, 0), (1.6 * 2 / 3, 1.6 / 3)),
        ((0.5, 1), (1 / 3, 1 / 3), (1, 2 / 3)),  # e_1 < e_2 < 4 e_1: both open, with the impulses of compression
        ((0.3, 0.9), (0.1, 0.4), (1.3 * 2 / 3, 1.9 / 3)),
        ((0, 1), (0, 1 / 2), (5 / 6, 2 / 3)),  # e_2 > 4 e_1: the recoil of ball 2 presses on ball 1
        ((0.1, 0.8), (0, 0.4), (2.2 / 3 + 0.4 / 6, 1.8 / 3)),
    ],
)
def test_three_balls(e, opening, impulse):
    """Lambda_C = (2, 1) / 3; the contacts open with (4 e_1 - e_2, 2 e_2 - 2 e_1) / 3, if neither is negative."""
    impact = Poisson(e).resolve(launched(3, 1))
    np.testing.assert_allclose(impact.compression.impulse, (2 / 3, 1 / 3), **EXACT)
    np.testing.assert_allclose(impact.compression.post_velocity, 1 / 3, **EXACT)
    np.testing.assert_allclose(impact.post_contact_velocity, opening, **EXACT)
    np.testing.assert_allclose(impact.impulse, impulse, **EXACT)
    np.testing.assert_allclose(impact.post_velocity, (1 - impulse[0], impulse[0] - impulse[1], impulse[1]), **EXACT)
    assert impact.has_distant_effect == (opening[1] > 0)
    assert impact.residual < 1e-15
    assert impact.violations.is_admissible(1e-15)
    newton = Newton(e).resolve(launched(3, 1))
    np.testing.assert_allclose(newton.post_contact_velocity, (e[0], 0), **EXACT)  # which sees that contact 2 is at rest


def test_rod_on_two_supports():
    """An elastic and a dead end: compression takes (1, 1) / 2, the elastic end gets 1/2 more, the dead one then 1/4."""
    impact = Poisson([1.0, 0.0]).resolve(rod())
    np.testing.assert_allclose(impact.compression.impulse, (1 / 2, 1 / 2), **EXACT)
    np.testing.assert_allclose(impact.least_impulse, (1, 1 / 2), **EXACT)
    np.testing.assert_allclose(impact.impulse, (1, 3 / 4), **EXACT)
    np.testing.assert_allclose(impact.post_contact_velocity, (3 / 2, 0), **EXACT)  # faster than it closed
    assert impact.energy_change / impact.collision.kinetic_energy == pytest.approx(-1 / 4, abs=1e-12)
    assert impact.antidissipative.tolist() == [True, False]
    assert impact.violations.is_admissible(1e-15)
    newton = Newton([1.0, 0.0]).resolve(rod())
    assert newton.energy_change / rod().kinetic_energy == pytest.approx(-2 / 3, abs=1e-12)
    assert not newton.has_distant_effect


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("problem_name", ["all separating", "zero velocity", "no contact"])
def test_nothing_happens(problem_name, e):
    impact = Poisson(e).resolve(PROBLEMS[problem_name]())
    np.testing.assert_array_equal(impact.post_velocity, impact.collision.pre_velocity)
    np.testing.assert_array_equal(impact.impulse, np.zeros(len(impact.collision.labels)))
    assert (impact.energy_change, impact.residual) == (0, 0)
    assert impact.violations.is_admissible(0.0)


# --- beside the other laws -------------------------------------------------------------------------------------------


def ordinary(seed: int) -> Collision:
    """Up to eight independent contacts of a random system, closing or not."""
    rng = np.random.default_rng([51, seed])
    h = int(rng.integers(1, 9))
    nv = h + int(rng.integers(0, 4))
    A = rng.normal(size=(nv, nv))
    return Collision(A @ A.T + np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv))


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_equal_coefficients_are_moreau_or_its_projection_on_the_tangent_cone(problem_name, e):
    c = PROBLEMS[problem_name]()
    moreau = Moreau(e).resolve(c).post_velocity
    nearest = MaximalDissipation().resolve(Collision(c.mass_matrix, c.jacobian, moreau)).post_velocity
    gap = c.metric.norm(Poisson(e).resolve(c).post_velocity - nearest)
    assert gap <= 1e-9 * c.pre_speed
    if (c.pre_contact_velocity <= 0).all():
        assert c.metric.norm(moreau - nearest) <= 1e-9 * c.pre_speed


def test_where_newton_penetrates_and_gains_energy_poisson_does_not():
    """Contacts that open before, with others that close, are outside of -T_C, where Newton's law says nothing good."""
    broken = {"kinematic": 0, "energetic": 0}
    distant = 0
    for seed in range(300):
        c = ordinary(seed)
        e = np.random.default_rng([52, seed]).uniform(size=len(c.labels)).tolist()
        newton, poisson = Newton(e).resolve(c), Poisson(e).resolve(c)
        broken["kinematic"] += newton.violations.kinematic > 1e-6 * c.pre_speed
        broken["energetic"] += newton.violations.energetic > 1e-6 * c.pre_speed
        assert poisson.violations.is_admissible(1e-12)
        assert (poisson.impulse >= (1 + np.array(e)) * poisson.compression.impulse * (1 - 1e-15)).all()
        assert poisson.residual < 1e-12
        distant += poisson.has_distant_effect
    assert broken["kinematic"] > 30
    assert broken["energetic"] > 0
    assert distant > 30


@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_admissible_on_every_problem(problem_name):
    c = PROBLEMS[problem_name]()
    for seed in range(10):
        e = np.random.default_rng([53, seed]).integers(0, 2, len(c.labels)).astype(float)
        impact = Poisson(e.tolist()).resolve(c)
        assert impact.violations.is_admissible()
        assert c.admissible_set.contains(impact.post_velocity, 1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_units_coordinates_and_order_do_not_matter(seed):
    c = ordinary(seed)
    rng = np.random.default_rng([54, seed])
    e = rng.uniform(size=len(c.labels))
    base = Poisson(e.tolist()).resolve(c)
    order, gaps = rng.permutation(len(e)), 10.0 ** rng.uniform(-3, 3, len(e))
    J = (c.jacobian * gaps[:, None])[order]
    other = Poisson(e[order].tolist()).resolve(Collision(1e3 * c.mass_matrix, J, 1e-2 * c.pre_velocity))
    np.testing.assert_allclose(1e2 * other.post_velocity, base.post_velocity, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.impulse * gaps[order], 10 * base.impulse[order], rtol=1e-9, atol=1e-9)


# --- redundant contacts ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tilt", [0.0, 0.3, 2.0])
def test_compression_is_of_least_norm_where_contacts_are_redundant(tilt):
    c = box(8, tilt)
    impact = Poisson(0.5).resolve(c)
    first = impact.compression
    tight = first.post_contact_velocity <= 1e-9
    assert least_norm_error(first.impulse, tight, c.jacobian) < 1e-12
    rows = impact.impulse.reshape(8, 8)
    np.testing.assert_allclose(rows, np.repeat(rows.mean(axis=1, keepdims=True), 8, axis=1), **EXACT)
    np.testing.assert_allclose(impact.post_velocity, Moreau(0.5).resolve(c).post_velocity, **EXACT)


@pytest.mark.parametrize("copies", [2, 5])
def test_duplicates_share_alike(copies):
    c, e = launched(4, 2), [0.3, 0.8, 0.5]
    one = Poisson(e).resolve(c)
    J = np.repeat(c.jacobian, copies, axis=0)
    many = Poisson(np.repeat(e, copies).tolist()).resolve(Collision(c.mass_matrix, J, c.pre_velocity))
    np.testing.assert_allclose(many.post_velocity, one.post_velocity, **EXACT)
    np.testing.assert_allclose(many.impulse, np.repeat(one.impulse, copies) / copies, **EXACT)


def test_two_copies_of_a_support_give_the_mean_of_their_coefficients():
    """Each takes half of the compression; Newton's law follows the larger coefficient."""
    c = Collision([[2.0]], [[1.0], [1.0]], [-1.0])
    np.testing.assert_allclose(Poisson([0.8, 0.2]).resolve(c).post_velocity, [0.5], **EXACT)
    np.testing.assert_allclose(Newton([0.8, 0.2]).resolve(c).post_velocity, [0.8], **EXACT)


def test_a_ball_between_two_walls():
    """It bounces off the first with 0.8 and is stopped by the second at once; Newton's law has no solution."""
    c = Collision([[2.0]], [[1.0], [-1.0]], [-1.0])
    with pytest.raises(UnsolvableLawError):
        Newton([0.8, 0.2]).resolve(c)
    impact = Poisson([0.8, 0.2]).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0.0], **EXACT)
    np.testing.assert_allclose(impact.impulse, [3.6, 1.6], **EXACT)


# --- the certificate -------------------------------------------------------------------------------------------------


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
    """Both get 1/10 more than they are due; they open faster than without it, by (1/10, 1/10)."""
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
    """Nearly opposite contacts: compression impulses 1e8 times the speed, of which different parts come back."""
    c, law = jamming(seed)
    impact = law.resolve(c)
    assert impact.compression.impulse @ c.gradient_norms > 1e6 * c.pre_speed
    assert impact.residual < 1e-9
    certificate = Certificate(impact, law)
    assert max(certificate.momentum, certificate.complementarity) < 1e-9
    assert impact.violations.energetic < 1e-9 * c.pre_speed


@pytest.mark.parametrize("seed", [26835, 28635, 47859, 49534])
def test_contacts_that_jam_beyond_all_digits_create_no_energy(seed):
    """Impulses 1e10 to 1e13 times the speed, whose rounding could be an outcome thousands of times as fast as v-."""
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


# --- solvers, sparse collisions, surfaces, steps ---------------------------------------------------------------------


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
    """E = 0 has no expansion to solve."""
    with pytest.raises(SolverError, match="solver 'closed-form'"):
        Poisson(0.0).resolve(launched(3, 1), solver="closed-form")


def test_what_nothing_penetrates_is_left_alone():
    """Rounding of contact velocities, here of contacts that end at 0, calls for no impulse."""
    impact = Poisson(0.3).resolve(launched(5, 2))
    np.testing.assert_array_equal(impact.impulse, 1.3 * impact.compression.impulse)


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
    """The table jumps to velocity u before compression: the ball leaves it with e u."""
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
    """A table under two balls at rest jumps to u: compression takes both along, expansion throws both off with e u."""
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
    """The scene's rod on an elastic and a dead end: impulses (1, 3/4) u, as by hand above, and two ends that open."""
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
