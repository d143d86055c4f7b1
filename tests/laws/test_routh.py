"""Routh's impact law: exact answers, an independent integration, energy, and its agreement with other laws."""

import numpy as np
import pytest
from laws.frictional import delassus_with_friction, one_contact
from scenes import compiled, run

from impactlaw import Collision, Coulomb, Friction, Moreau, Newton, Poisson, Routh, Stepper
from impactlaw.errors import RestitutionError, SolverError, UnknownNameError, UnsolvableLawError


def disc(velocity, mu, k=0.5) -> Collision:
    """Return a disc of mass 1, radius 1 and inertia k on the floor; velocity is (x, y, omega), counterclockwise."""
    return Collision(np.diag([1, 1, k]), [[0, 1, 0]], velocity, friction=Friction([[1, 0, 1]], [0], [mu]))


def march(c: Collision, e: float, hypothesis: str, steps: int = 200_000) -> np.ndarray:
    """Return v+ by many small steps of normal impulse."""
    G, gamma = delassus_with_friction(c)
    mu, dN = c.friction.coefficient[0], 8.0 * -gamma[0] / G[0, 0] / steps * 10
    impulse, N, work, compression = np.zeros(2), 0.0, 0.0, None
    for _ in range(steps):
        if abs(gamma[1]) > 2.0 * dN * (abs(G[1, 0]) + mu * G[1, 1]):
            f = -mu * np.sign(gamma[1])
        else:
            f = np.clip(-(gamma[1] / dN + G[1, 0]) / G[1, 1], -mu, mu)
        step = np.array([dN, f * dN])
        work += (gamma[0] + 0.5 * (G @ step)[0]) * dN
        gamma, impulse, N = gamma + G @ step, impulse + step, N + dN
        if compression is None and gamma[0] >= 0.0:
            compression, taken, work = N, -work, 0.0
        if compression is not None and (
            (1 + e) * compression <= N if hypothesis == "poisson" else work >= e * e * taken
        ):
            break
    J = np.vstack([c.jacobian, c.friction.jacobian])
    return c.pre_velocity + np.linalg.solve(c.mass_matrix, J.T @ impulse)


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
def test_slides_all_the_way(hypothesis):
    impact = Routh(0.5, hypothesis=hypothesis).resolve(disc([10.0, -1.0, 0.0], 0.2))
    np.testing.assert_allclose(impact.impulse, [1.5], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.friction_impulse, [-0.3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.post_velocity, [9.7, 0.5, -0.6], rtol=0, atol=1e-12)


def test_sticks():
    """A slip of 0.3 stops after N = 0.3 / (0.5 * 3) = 0.2; a disc on a flat floor then rolls."""
    impact = Routh(0.5).resolve(disc([0.3, -1.0, 0.0], 0.5))
    np.testing.assert_allclose(impact.friction_impulse, [-0.1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.post_velocity, [0.2, 0.5, -0.2], rtol=0, atol=1e-12)


def test_slip_reverses():
    """G = [[2, 1], [1, 1]], mu = 0.5: slip -1 stops at N = 2/3, then becomes positive at rate 1/2; by hand."""
    J = np.linalg.cholesky(np.array([[2.0, 1.0], [1.0, 1.0]]))
    v = np.linalg.solve(J, [-3.0, -1.0])
    c = Collision(np.eye(2), J[:1], v, friction=Friction(J[1:], [0], [0.5]))
    # rates of gamma_n: 2.5, then 1.5: -3 + 2.5 * 2/3 = -4/3, compression ends at 2/3 + 8/9 = 14/9
    N = 1.5 * 14 / 9
    impact = Routh(0.5).resolve(c)
    np.testing.assert_allclose(impact.impulse, [N], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.friction_impulse, [0.5 * 2 / 3 - 0.5 * (N - 2 / 3)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.post_sliding_velocity, [0.5 * (N - 2 / 3)], rtol=0, atol=1e-12)
    # Stronge: work taken = (3 + 4/3) / 2 * 2/3 + 4/3 * 8/9 / 2 = 55/27; 0.75 x^2 = 55/27 / 4 after compression
    x = np.sqrt(55 / 27 / 4 / 0.75)
    stronge = Routh(0.5, hypothesis="stronge").resolve(c)
    np.testing.assert_allclose(stronge.impulse, [14 / 9 + x], rtol=0, atol=1e-12)


def test_jams():
    """mu G_nt > G_nn: the normal impulse first drives the contact deeper, until the slip has stopped."""
    G = np.array([[1.0, 1.5], [1.5, 4.0]])
    J = np.linalg.cholesky(G)
    c = Collision(np.eye(2), J[:1], np.linalg.solve(J, [-1.0, 2.0]), friction=Friction(J[1:], [0], [1.0]))
    impact = Routh(0.0).resolve(c)
    # gamma_n' = 1 - 1.5 = -0.5, slip' = 1.5 - 4 = -2.5: it stops at N = 0.8, where gamma_n = -1.4
    rest = 1.4 / (1.0 - 1.5**2 / 4.0)
    np.testing.assert_allclose(impact.impulse, [0.8 + rest], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.friction_impulse, [-0.8 - 1.5 / 4.0 * rest], rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.post_contact_velocity, [0.0], rtol=0, atol=1e-12)


def hinged(rng, mu, directions) -> Collision:
    """Return a body on a hinge that closes at 1 rad/s; all gradients of its contact are parallel."""
    along = np.array([[rng.normal()], [rng.normal()]])[:directions]
    return Collision(
        [[rng.uniform(0.5, 2.0)]], [[1.0]], [-1.0], friction=Friction(along, [0] * directions, [mu] * directions)
    )


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
@pytest.mark.parametrize("directions", [1, 2])
def test_a_body_on_a_hinge_jams_or_leaves(hypothesis, directions):
    """Friction helps to stop it and opposes its return; with ``r = mu |J_t| < |J_n| = 1`` it leaves.

    ``M dv = (1 + r) dN`` while it closes, ``M dv = (1 - r) dN`` while it opens; friction reverses at once in between.
    """
    rng = np.random.default_rng(11)
    for _ in range(200):
        c = hinged(rng, rng.uniform(0.1, 3.0), directions)
        r = c.friction.coefficient[0] * np.linalg.norm(c.friction.jacobian)
        ratio = max(0.0, 1.0 - r) / (1.0 + r)
        expected = 0.7 * (ratio if hypothesis == "poisson" else np.sqrt(ratio))
        impact = Routh(0.7, hypothesis=hypothesis).resolve(c)
        np.testing.assert_allclose(impact.post_velocity, [expected], rtol=0, atol=1e-9)
        assert impact.violations.is_admissible(1e-9)


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_three_gradients_of_two_degrees_of_freedom(hypothesis, restitution):
    """When slip stops, the contact stops as well; where friction can hold it, no rebound remains."""
    rng = np.random.default_rng(12)
    for _ in range(100):
        A, J, v = rng.normal(size=(2, 2)), rng.normal(size=(3, 2)), rng.normal(size=2)
        J[0] *= -np.sign(J[0] @ v)
        rows = Friction(J[1:], [0, 0], [0.7, 0.7])
        c = Collision(A @ A.T + 0.1 * np.eye(2), J[:1], v, friction=rows)
        impact = Routh(restitution, hypothesis=hypothesis).resolve(c)
        assert impact.violations.is_admissible(1e-7)


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
@pytest.mark.parametrize(
    "options",
    [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}],
)
def test_a_pendulum_that_jams_on_the_floor_stays(hypothesis, options):
    """Its bob hits a floor 0.6 m below the hinge: friction of 2 holds it at an angle of 0.9397 rad."""
    world = """<geom name="floor" type="plane" size="9 9 1" pos="0 0 -.6" friction="2"/>
        <body><joint type="hinge" axis="0 1 0"/><geom name="bob" size=".01" pos="0 0 -1" friction="2"/></body>"""
    model, data = compiled(world, option='integrator="RK4"')
    data.qpos[0] = 1.57
    stepper = Stepper(model, Routh(0.5, hypothesis=hypothesis), **options)
    events = run(stepper, data, 250)
    assert events
    assert abs(events[0].impact.post_velocity[0]) < 1e-9
    assert data.qpos[0] == pytest.approx(np.arccos(0.59), abs=2e-3)
    assert stepper.short_steps == 0


def test_a_contact_that_cannot_open_is_refused():
    """A table rises against a body that can only slide along it."""
    c = Collision([[1.0]], [[0.0], [1.0]], [-1.0], surface_velocity=[-2.0, 0.0], labels=("table", "wall"))
    with pytest.raises(UnsolvableLawError) as refused:
        Routh(0.5).resolve(c)
    assert refused.value.contacts == ("table",)


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
@pytest.mark.parametrize("condim", [1, 3])
def test_a_body_that_cannot_give_way_ends_no_run(options, condim):
    world = """<body mocap="true" pos="0 0 -.2"><geom type="box" size="1 1 .1"/></body>
        <body pos="0 0 .1"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>"""
    model, data = compiled(world, geom=f'condim="{condim}"')
    stepper = Stepper(model, Routh(0.5), **options)
    for i in range(60):
        data.mocap_pos[0, 2] = -0.2 + 0.002 * (i + 1)
        stepper.step(data)
    assert stepper.short_steps > 0


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
@pytest.mark.parametrize("seed", range(4))
def test_against_small_steps(hypothesis, seed):
    c = one_contact(np.random.default_rng([5, seed]))
    impact = Routh(0.6, hypothesis=hypothesis).resolve(c)
    assert impact.restitution_scale == 1.0
    np.testing.assert_allclose(march(c, 0.6, hypothesis), impact.post_velocity, rtol=0, atol=2e-3 * c.pre_speed)


def test_it_is_poissons_law_with_friction_where_slip_does_not_reverse():
    same = reversed_ = 0
    for seed in range(300):
        c = one_contact(np.random.default_rng([6, seed]), largest=1.0)
        e = np.random.default_rng(seed).uniform()
        one, two = Routh(e).resolve(c), Coulomb(Poisson(e)).resolve(c)
        before, after = one.pre_sliding_velocity[0], one.post_sliding_velocity[0]
        difference = c.metric.norm(one.post_velocity - two.post_velocity)
        if before * after < -1e-9:
            reversed_ += 1
            continue
        same += 1
        assert difference < 1e-7 * c.pre_speed
    assert same > 200
    assert reversed_ > 5


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
@pytest.mark.parametrize("directions", [1, 2, 3])
def test_never_creates_energy(hypothesis, directions):
    for seed in range(1000 if directions == 1 else 100):
        rng = np.random.default_rng([7, seed])
        c = one_contact(rng, directions)
        impact = Routh(1.0 if seed % 3 else rng.uniform(), hypothesis=hypothesis).resolve(c)
        assert impact.energy_change <= 1e-12 * c.kinetic_energy
        assert impact.violations.is_admissible(1e-9)
        assert impact.residual < 1e-9


def test_stronge_returns_e2_of_the_normal_work():
    """Without friction the normal work is all the work, and the law is Newton's."""
    c = Collision(np.diag([1.0, 3.0]), [[1.0, -2.0]], [-1.0, 0.3])
    for hypothesis in ("poisson", "stronge"):
        v = Routh(0.7, hypothesis=hypothesis).resolve(c).post_velocity
        np.testing.assert_allclose(v, Newton(0.7).resolve(c).post_velocity, rtol=0, atol=1e-12)


def test_two_directions_agree_with_one():
    """Slip along one of two directions that do not influence each other."""
    for seed in range(20):
        c = one_contact(np.random.default_rng([8, seed]), largest=0.8)
        nv, mu = len(c.pre_velocity), c.friction.coefficient[0]
        M = np.eye(nv + 1)
        M[:nv, :nv] = c.mass_matrix
        J_t = np.zeros((2, nv + 1))
        J_t[0, :nv], J_t[1, nv] = c.friction.jacobian[0], 1.0
        rows = Friction(J_t, [0, 0], [mu, mu])
        wide = Collision(M, np.append(c.jacobian, 0.0)[None], np.append(c.pre_velocity, 0.0), friction=rows)
        found = Routh(0.6).resolve(wide).post_velocity
        np.testing.assert_allclose(found[:nv], Routh(0.6).resolve(c).post_velocity, rtol=0, atol=1e-7)


def test_slip_that_turns_does_not_depend_on_the_axes():
    rng = np.random.default_rng(9)
    for _ in range(20):
        c = one_contact(rng, 2, largest=0.7)
        a = rng.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        rows = Friction(turn @ c.friction.jacobian, [0, 0], c.friction.coefficient)
        other = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=rows)
        one, two = (Routh(0.5).resolve(x).post_velocity for x in (c, other))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-8)


def test_contacts_apart_collide_together():
    c = Collision(
        np.eye(4), [[0, 1, 0, 0], [0, 0, 0, 1]], [3.0, -1.0, 0.1, -2.0], labels=("a/floor", "b/floor"),
        friction=Friction([[1, 0, 0, 0], [0, 0, 1, 0]], [0, 1], [0.5, 0.2]),
    )  # fmt: skip
    impact = Routh({"a/floor": 1.0, "floor/b": 0.5}).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [2.0, 1.0, 0.0, 1.0], rtol=0, atol=1e-12)


def test_contacts_that_influence_each_other_are_refused():
    c = Collision(np.eye(2), [[1.0, 0.0], [1.0, 1.0]], [-1.0, 0.0], labels=("left/floor", "right/floor"))
    with pytest.raises(RestitutionError, match="left/floor and right/floor collide together"):
        Routh(0.5).resolve(c)
    with pytest.raises(UnknownNameError, match="hypothesis"):
        Routh(0.5, hypothesis="newton")  # pyright: ignore[reportArgumentType]


def test_velocities_beyond_all_numbers_are_an_error():
    c = Collision(np.eye(2), [[0, 1]], [3e160, -1e160], friction=Friction([[1, 0]], [0], [0.5]))
    with np.errstate(all="ignore"), pytest.raises(SolverError, match=r"closes at 1e\+160 m/s .* check the units"):
        Routh(0.5, hypothesis="stronge").resolve(c)


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}])
def test_a_ball_in_rigid_steps(options):
    """A spinning ball lands: both ways to step give it the velocity of the law."""
    model, data = compiled(
        '<geom name="floor" type="plane" size="5 5 1"/><body name="ball" pos="0 0 .15"><freejoint/>'
        '<geom name="ball" size=".1" mass="1"/></body>',
        option='timestep="1e-3"',
        geom='friction=".3" condim="3"',
    )
    data.qvel[:] = [1.0, 0.5, -1.0, 0.0, 30.0, 5.0]
    stepper = Stepper(model, Routh(0.6, hypothesis="stronge"), **options)
    while not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    expected = Routh(0.6, hypothesis="stronge").resolve(impact.collision)
    np.testing.assert_allclose(impact.post_velocity, expected.post_velocity, rtol=0, atol=1e-6)
    assert abs(impact.friction_impulse).max() > 0.1


def test_a_ball_in_soft_steps_has_the_normal_part_where_friction_is_left_out():
    model, data = compiled(
        '<geom name="floor" type="plane" size="5 5 1"/><body pos="0 0 .15"><freejoint/>'
        '<geom size=".1" mass="1"/></body>'
    )
    data.qvel[:3] = 1.0, 0.0, -2.0
    stepper = Stepper(model, Routh(0.6), contact_model="soft", friction="ignore")
    while not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    np.testing.assert_allclose(impact.post_contact_velocity, -0.6 * impact.collision.pre_contact_velocity, rtol=1e-9)
    np.testing.assert_allclose(impact.post_velocity[0], impact.collision.pre_velocity[0], rtol=1e-12)


def test_convex_friction_is_refused():
    model, _ = compiled('<geom name="floor" type="plane" size="5 5 1"/>')
    with pytest.raises(RestitutionError, match="contradicts it"):
        Stepper(model, Routh(0.5), friction="convex")


@pytest.mark.parametrize("model", ["rigid", "soft"])
def test_a_named_solver_is_refused_before_the_first_collision(model):
    scene, _ = compiled('<geom name="floor" type="plane" size="5 5 1"/>')
    with pytest.raises(RestitutionError, match="finds its impulses itself: solver='nnls'"):
        Stepper(scene, Routh(0.5), contact_model=model, solver="nnls")
    stepper = Stepper(scene, Moreau(0.5), contact_model=model, solver="nnls")
    with pytest.raises(RestitutionError, match="finds its impulses itself"):
        stepper.law = Routh(0.5)
    assert stepper.law == Moreau(0.5)
