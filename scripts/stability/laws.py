"""The cases of the stability study in which a law resolves one collision, without a scene.

In all of them every contact closes (``gamma- <= 0``), so that no law of the study may leave a contact penetrating.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.sparse.csgraph import connected_components

from impactlaw import Collision, Fremond, Law, MaximalDissipation, Moreau, Newton
from impactlaw.errors import UnsolvableLawError
from impactlaw.solvers import SOLVERS

from .certificate import certify
from .verdicts import EITHER, REFUSED, Case, Expected, Measurement, WrongRefusalError
from .watch import coefficient

Numbers = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Mass matrix, gap gradients and velocity before the collision."""

ALMOST_ONE = 1.0 - 1e-16
BASIC = ("maximal-dissipation", "moreau 0.5", "moreau 1", "moreau 1 - 1e-16", "newton 0 .. 1")
CHAIN = (*BASIC, "reversal 1")
EVERY = (*SOLVERS, "auto")


def law_of(name: str, h: int) -> Law:
    """Return a law of the study for h contacts."""
    if name == "reversal 1":
        return Fremond.reversal()
    if name == "maximal-dissipation":
        return MaximalDissipation()
    e = _coefficients(name, h)
    return Newton(e.tolist()) if name == "newton 0 .. 1" else Moreau(float(e[0]))


def _coefficients(name: str, h: int) -> np.ndarray:
    if name == "newton 0 .. 1":
        return np.resize([0.0, 1.0, ALMOST_ONE, 0.3, 0.7], h)
    return np.full(h, ALMOST_ONE if name == "moreau 1 - 1e-16" else coefficient(name))


def _wanted(name: str, gamma: np.ndarray) -> np.ndarray:
    """Return ``gamma^h = -E gamma-`` by the definition of the law."""
    return -gamma[::-1] if name == "reversal 1" else -_coefficients(name, len(gamma)) * gamma


def _measure(numbers: Callable[[bool], Numbers], law: str, solver: str, quick: bool) -> Measurement:
    M, J, v = numbers(quick)
    try:
        impact = law_of(law, len(J)).resolve(Collision(M, J, v), solver=solver)
    except UnsolvableLawError as error:
        _check_ray(error.ray, M, J, v, _wanted(law, J @ v))
        raise
    impulse, after = impact.impulse, impact.post_velocity
    residual, energy, penetration = _of_the_rest(M, J, v, after), 0.0, 0.0
    for rows, columns in _blocks(J, M):
        part = np.ix_(rows, columns)
        inertia, wanted = M[np.ix_(columns, columns)], _wanted(law, J @ v)[rows]
        found = certify(inertia, J[part], v[columns], after[columns], impulse[rows], wanted)
        residual, penetration = max(residual, found.residual), max(penetration, found.penetration)
        energy = max(energy, found.balance)
        if law.startswith(("maximal", "moreau")):
            energy = max(energy, found.change)
        if law in ("moreau 1", "moreau 1 - 1e-16"):
            energy = max(energy, -found.change)
    if not (np.isfinite(impulse).all() and (impulse >= 0).all()):
        residual = np.inf
    return Measurement(residual, energy, penetration, collisions=1)


def _of_the_rest(M: np.ndarray, J: np.ndarray, v: np.ndarray, after: np.ndarray) -> float:
    """Return the change of velocities that no contact can reach, relative to the speed of the whole system."""
    free = np.setdiff1d(np.arange(len(v)), np.concatenate([columns for _, columns in _blocks(J, M)] or [[]]))
    change = np.sqrt(np.diag(M)[free]) * (after - v)[free]
    return float(np.linalg.norm(change) / (np.sqrt(v @ M @ v) or 1.0))


def _check_ray(ray: np.ndarray, M: np.ndarray, J: np.ndarray, v: np.ndarray, wanted: np.ndarray) -> None:
    """Raise unless a refusal's ray satisfies ``nu >= 0, J^T nu = 0, nu^T (gamma^h - gamma-) > 0``."""
    scale = np.sqrt(np.diag(M))
    Y = J / scale
    unbalanced = np.linalg.norm(ray @ Y) / (ray @ np.linalg.norm(Y, axis=1) or 1.0)
    conflict = ray @ (wanted - J @ v)
    if not ((ray >= 0).all() and unbalanced <= 1e-9 and conflict > 0):
        raise WrongRefusalError(f"ray with |J^T nu| = {unbalanced:.1e} and conflict {conflict:.1e} proves nothing")


def _blocks(J: np.ndarray, M: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the contacts and the velocities of each independent part that has contacts."""
    moves = (J != 0).astype(int)
    count, member = connected_components(moves.T @ moves + (M != 0), directed=False)
    columns = [np.flatnonzero(member == part) for part in range(count)]
    parts = [(np.flatnonzero(moves[:, these].any(axis=1)), these) for these in columns]
    return [part for part in parts if len(part[0])]


# --- the numbers of the cases ----------------------------------------------------------------------------------------


def _balls(masses, velocities, quick: bool) -> Numbers:
    """Return touching balls on a line, ``gamma_i = v_{i+1} - v_i``."""
    n = len(masses)
    return np.diag(np.asarray(masses, float)), np.diff(np.eye(n), axis=0), np.asarray(velocities, float)


def _duplicated(copies: int, quick: bool) -> Numbers:
    J = np.repeat([[1.0, 0.0, 0.2], [0.6, 0.8, -0.1]], copies, axis=0)
    return np.diag([1.0, 2.0, 0.1]), J, np.array([-1.0, -0.5, 0.0])


def _coplanar(columns: int, rows: int, tilt: float, quick: bool) -> Numbers:
    """Return a cube of mass 2 and half edge 1 that lands on a grid of points of its bottom face."""
    columns = columns // 5 if quick and columns > 8 else columns
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows)))
    J = np.zeros((len(x), 6))
    J[:, 2], J[:, 3], J[:, 4] = 1.0, y, -x
    return np.diag([2.0] * 3 + [4.0 / 3.0] * 3), J, np.array([0.3, 0.0, -1.0, tilt, 0.0, 0.0])


def _parallel(angle: float, quick: bool) -> Numbers:
    """Return six closing contacts with almost parallel normals, a few times the angle apart."""
    turn = angle * np.array([0.0, 1.0, -1.0, 2.0, -2.0, 1.0])
    J = np.column_stack([np.sin(turn), np.cos(turn), angle * np.arange(6.0)])
    return np.diag([1.0, 2.0, 3.0]), J, np.array([0.25, -1.0, -0.5])


def _opposite(angle: float, quick: bool) -> Numbers:
    """Return a ball that moves into a wedge of two walls that are parallel up to an angle."""
    return np.eye(2), np.array([[1.0, angle], [-1.0, angle]]), np.array([0.2 * angle, -1.0])


def _conditioned(condition: float, dependent: bool, quick: bool) -> Numbers:
    """Return 12 contacts with 9 velocities, or 8 with 8, whose Delassus matrix has this condition number."""
    rng = np.random.default_rng(7)
    h, nv = (12, 9) if dependent else (8, 8)
    n = min(h, nv)
    U = np.linalg.qr(rng.normal(size=(h, n)))[0]
    V = np.linalg.qr(rng.normal(size=(nv, n)))[0]
    J = (U * np.geomspace(1.0, condition**-0.5, n)) @ V.T
    v = rng.normal(size=nv)
    return np.eye(nv), -np.sign(J @ v)[:, None] * J, v


def _inertia(condition: float, quick: bool) -> Numbers:
    """Return six contacts with a full mass matrix of this condition number."""
    rng = np.random.default_rng(8)
    Q = np.linalg.qr(rng.normal(size=(8, 8)))[0]
    M = (Q * np.geomspace(1.0, condition, 8)) @ Q.T
    J, v = rng.normal(size=(6, 8)), rng.normal(size=8)
    return 0.5 * (M + M.T), -np.sign(J @ v)[:, None] * J, v


def _zero_rows(others: bool, quick: bool) -> Numbers:
    J = np.zeros((4, 3))
    if others:
        J[1], J[3] = [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]
    return np.diag([1.0, 2.0, 3.0]), J, np.array([-1.0, -2.0, 3.0])


def _two_speeds(coupled: bool, quick: bool) -> Numbers:
    """Return two balls that hit separate walls at 1e8 and 1e-12 m/s; if coupled, a third contact acts on both."""
    J = np.array([[1.0, 0.0], [0.0, 1.0]] + [[1.0, 1.0]] * coupled)
    return np.eye(2), J, np.array([-1e8, -1e-12])


# --- the cases -------------------------------------------------------------------------------------------------------

_ONE_CONTACT = Expected(REFUSED, "solves problems of one contact only", "SolverError", solver="closed-form")
_REDUNDANT = Expected(
    REFUSED,
    "no velocity has all wanted contact velocities, it only exceeds some",
    "SolverError",
    "newton 0 .. 1",
    "nnls",
)
_DAQP = "impulses cancel to 1e-12 and more, beyond its tolerances"
_CANCELS = Expected(REFUSED, _DAQP, "SolverError", solver="dual-active-set")


_SINGULAR = Expected(
    EITHER, "factors the Delassus matrix, singular to rounding here", "SolverError", solver="primal-dual-active-set"
)
_ITERATIVE = tuple(
    Expected(EITHER, "iterative: an answer where it converges to 1e-9, else a refusal", "SolverError", solver=solver)
    for solver in ("osqp", "projected-gauss-seidel")
)


def _case(
    name: str, numbers: Callable[[bool], Numbers], *expected: Expected, laws: tuple[str, ...] = BASIC, one: bool = False
) -> Case:
    rules = (*expected, *_ITERATIVE) if one else (*expected, _ONE_CONTACT, *_ITERATIVE)
    return Case(name, "law", partial(_measure, numbers), laws, EVERY, rules)


def cases() -> list[Case]:
    """Return the cases of a law without a scene."""
    return [*_mass_cases(), *_contact_cases(), *_condition_cases(), *_speed_cases()]


def _mass_cases() -> Iterator[Case]:
    line = np.linspace(1.0, -1.0, 9)
    for power in (-12, -6, 6, 12):
        ratio, light, heavy = 10.0**power, power == -12, power == 12
        two, between = partial(_balls, [1.0, ratio], [1.0, -1.0]), partial(_balls, [1.0, ratio, 1.0], [1.0, 0.0, -1.0])
        yield _case(f"two balls, masses 1 and 1e{power:+d}", two, laws=CHAIN, one=True)
        rules = (_CANCELS, _SINGULAR) if light else ()
        yield _case(f"ball of 1e{power:+d} between two of 1", between, *rules, laws=CHAIN)
        rules = (_CANCELS, _SINGULAR) if light or heavy else ()
        alternating = partial(_balls, [ratio ** (i % 2) for i in range(9)], line)
        yield _case(f"nine balls, 1 and 1e{power:+d} in turn", alternating, *rules, laws=CHAIN)
        yield _case(f"nine balls, 1 up to 1e{power:+d}", partial(_balls, np.geomspace(1.0, ratio, 9), line), laws=CHAIN)


def _contact_cases() -> Iterator[Case]:
    for copies in (2, 50):
        yield _case(f"two contacts, {copies} times each", partial(_duplicated, copies), _REDUNDANT)
    for tilt in (0.0, 0.4):
        yield _case(f"64 coplanar contacts, tilt {tilt:g}", partial(_coplanar, 8, 8, tilt), _REDUNDANT)
        points = partial(_coplanar, 40, 25, tilt)
        yield _case(f"1000 coplanar contacts, tilt {tilt:g}", points, _REDUNDANT)
    for angle in (1e-4, 1e-8, 1e-12):
        yield _case(f"six normals within {angle:g} rad", partial(_parallel, angle), _REDUNDANT, _SINGULAR)
        rules = () if angle > 1e-6 else (_CANCELS, _SINGULAR)
        yield _case(f"walls opposite but for {angle:g} rad", partial(_opposite, angle), *rules)
    yield _case("two of four gradients are zero", partial(_zero_rows, True))
    yield _case("all gradients are zero", partial(_zero_rows, False), one=True)


def _condition_cases() -> Iterator[Case]:
    for power in (4, 8, 12, 16):
        condition = 10.0**power
        yield _case(f"Delassus matrix of condition 1e{power}", partial(_conditioned, condition, False))
        dependent = partial(_conditioned, condition, True)
        yield _case(f"the same, 12 contacts of rank 9, 1e{power}", dependent, _REDUNDANT)
    for power in (6, 12):
        yield _case(f"mass matrix of condition 1e{power}", partial(_inertia, 10.0**power))


def _speed_cases() -> Iterator[Case]:
    for power in (-12, -6, 0, 4, 8):
        balls = partial(_balls, np.ones(5), 10.0**power * np.array([1.0, 1.0, 0.0, 0.0, -0.5]))
        yield _case(f"five balls at 1e{power:+d} m/s", balls, laws=CHAIN)
    yield _case("1e8 and 1e-12 m/s, coupled", partial(_two_speeds, True), _REDUNDANT)
    yield _case("1e8 and 1e-12 m/s, apart", partial(_two_speeds, False), one=True)
