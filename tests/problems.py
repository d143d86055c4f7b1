"""Collisions and laws that several test files share, and checks that use nothing of the implementation."""

from collections.abc import Callable
from fractions import Fraction
from itertools import chain, combinations

import numpy as np
import scipy.sparse
from scipy.optimize import nnls

from impactlaw import Collision, Fremond, Friction, Impact, Law, LinearMap, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.laws import RestitutionLaw
from impactlaw.laws.registry import REGISTERED


def balls(masses, velocities) -> Collision:
    """Touching balls on a line, gamma_i = v_{i+1} - v_i."""
    n = len(masses)
    return Collision(np.diag(np.asarray(masses, dtype=float)), np.diff(np.eye(n), axis=0), velocities)


def launched(n: int, k: int) -> Collision:
    """n equal balls of which the first k come in with velocity 1."""
    return balls(np.ones(n), (np.arange(n) < k).astype(float))


def rod() -> Collision:
    """A uniform rod of mass 1 and length 2 falls flat with velocity 1 on supports under its two ends."""
    return Collision(np.diag([1.0, 1.0 / 3.0]), [[1.0, -1.0], [1.0, 1.0]], [-1.0, 0.0])


def box(side: int = 2, tilt: float = 0.0) -> Collision:
    """A cube of mass 2 and half edge 1 falls with velocity 1 on side x side points of its bottom face."""
    at = np.linspace(-1.0, 1.0, side)
    x, y = (a.ravel() for a in np.meshgrid(at, at))
    J = np.zeros((side * side, 6))
    J[:, 2], J[:, 3], J[:, 4] = 1.0, y, -x
    return Collision(np.diag([2.0] * 3 + [4.0 / 3.0] * 3), J, [0.3, 0.0, -1.0, tilt, 0.0, 0.0])


def _closing(M, J) -> Collision:
    return Collision(M, J, -np.linalg.lstsq(J, np.ones(len(J)), rcond=None)[0])


def _dense() -> Collision:
    rng = np.random.default_rng(1)
    A, J = rng.normal(size=(9, 9)), rng.normal(size=(6, 9))
    return _closing(A @ A.T + 0.1 * np.eye(9), J)


def _rank_deficient() -> Collision:
    rng = np.random.default_rng(2)
    J = rng.normal(size=(10, 3)) @ rng.normal(size=(3, 8))
    return Collision(np.diag(rng.uniform(0.5, 2.0, 8)), J, rng.normal(size=8))


def _nearly_parallel() -> Collision:
    J = np.ones((4, 1)) * [1.0, 2.0, -1.0] + 1e-7 * np.random.default_rng(3).normal(size=(4, 3))
    return Collision(np.diag([1.0, 2.0, 3.0]), J, [-1.0, -0.5, 0.25])


PROBLEMS: dict[str, Callable[[], Collision]] = {
    "one contact": lambda: Collision([[2.0]], [[1.0]], [-3.0]),
    "three balls": lambda: launched(3, 1),
    "five balls": lambda: launched(5, 2),
    "rod": rod,
    "box on its corners": box,
    "tilted box": lambda: box(tilt=0.4),
    "box on 64 points": lambda: box(8),
    "duplicated contacts": lambda: Collision(np.diag([1.0, 2.0]), [[1.0, 0.0]] * 3 + [[1.0, 1.0]] * 2, [-1.0, -0.5]),
    "nearly parallel contacts": _nearly_parallel,
    "wedge": lambda: Collision(np.eye(2), [[1.0, 1e-3], [-1.0, 1e-3]], [0.2, -300.0]),
    "ball between two walls": lambda: Collision([[2.0]], [[1.0], [-3.0]], [-1.0]),
    "random dense": _dense,
    "light ball hits heavy ones": lambda: balls([1e-6, 1e6, 1e6, 1e-6], [1.0, 0.0, 0.0, -1.0]),
    "heavy ball hits light ones": lambda: balls([1e6, 1e-6, 1e-6, 1e6], [1.0, 0.0, 0.0, 0.0]),
    "chain of 64": lambda: balls(np.ones(65), -(np.linspace(-1.0, 1.0, 65) ** 3)),
    "rank deficient": _rank_deficient,
    "slow contact of a fast system": lambda: Collision(np.eye(3), [[0.0, 0.0, 1.0], [0.0, 1e-3, 1.0]], [1e6, 0, -1e-6]),
    "contact that cannot move": lambda: Collision(np.eye(2), [[0.0, 0.0], [1.0, 0.0]], [-1.0, 2.0]),
    "all separating": lambda: balls([1.0, 2.0, 3.0], [-1.0, 0.0, 1.0]),
    "zero velocity": lambda: balls([1.0, 2.0, 3.0], [0.0, 0.0, 0.0]),
    "no contact": lambda: Collision(np.eye(2), np.zeros((0, 2)), [1.0, -2.0]),
}

SWAPPED = np.array([[0.0, 1.0], [1.0, 0.0]])


def _per_contact(c: Collision) -> Law:
    return Newton(np.random.default_rng(4).uniform(size=len(c.labels)))


def _poisson(c: Collision) -> Law:
    return Poisson(np.random.default_rng(4).uniform(size=len(c.labels)))


def _full(c: Collision) -> Law:
    h = len(c.labels)
    return Fremond(np.random.default_rng(5).normal(size=(h, h)) / max(1, h))


def _map(c: Collision) -> Law:
    nv = len(c.pre_velocity)
    return LinearMap(np.random.default_rng(6).normal(size=(nv, nv)))


OF_SOME = {"routh", "compliant", "any-outcome"}
"""Laws for some collisions only, or that draw: `laws/test_registry.py` tries them, and files of their own."""

LAWS: dict[str, Callable[[Collision], Law]] = {
    "maximal dissipation": lambda c: MaximalDissipation(),
    "moreau 0": lambda c: Moreau(0.0),
    "moreau 0.5": lambda c: Moreau(0.5),
    "moreau 1": lambda c: Moreau(1.0),
    "newton scalar": lambda c: Newton(0.3),
    "newton per contact": _per_contact,
    "newton of speed": lambda c: Newton(lambda speed: 1.0 / (1.0 + speed)),
    "poisson scalar": lambda c: Poisson(0.3),
    "poisson per contact": _poisson,
    "fremond full": _full,
    "reversal": lambda c: Fremond.reversal(),
    "linear map": _map,
}
for _law in REGISTERED:  # a law that is new is tried on every problem as `make_law` makes it
    if _law.name not in OF_SOME and not any(title.startswith(_law.name.split("-")[0]) for title in LAWS):
        LAWS[_law.name] = lambda c, law=_law: law.of(0.5)


def spd(rng: np.random.Generator, n: int, condition: float) -> np.ndarray:
    """A random symmetric matrix with eigenvalues over the whole range of the condition number."""
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    d = np.exp(rng.uniform(-0.5, 0.5, n) * np.log(condition))
    d[: min(n, 2)] = [condition**-0.5, condition**0.5][: min(n, 2)]
    M = (Q * d) @ Q.T
    return 0.5 * (M + M.T)


def random_collision(rng: np.random.Generator, most: int = 64) -> Collision:
    """Up to ``most`` contacts: masses 1e-6 to 1e6 or condition to 1e12; dependent, duplicated, nearly parallel and
    opposite gradients; rows, and columns where the masses are equal, scaled 1e-3 to 1e3; fast, slow and closing."""
    h = int(np.exp(rng.uniform(0.0, np.log(most + 1))))
    nv = int(rng.integers(1, min(40, 2 * h + 4)))
    shape, inertia, speed = rng.integers(6), rng.integers(3), rng.integers(4)
    if shape == 0:
        J = rng.normal(size=(h, nv))
    elif shape == 1:
        r = int(rng.integers(1, min(h, nv) + 1))
        J = rng.normal(size=(h, r)) @ rng.normal(size=(r, nv))
    elif shape == 2:
        J = rng.normal(size=(h // 2 + 1, nv))[rng.integers(0, h // 2 + 1, h)]
    elif shape == 3:
        nv = h + 1
        J = np.diff(np.eye(nv), axis=0)
    elif shape == 4:
        opposite = rng.uniform() < 0.5
        J = rng.normal(size=(1, nv)) + 10.0 ** rng.uniform(-8 if opposite else -12, 0) * rng.normal(size=(h, nv))
        J *= rng.choice([-1.0, 1.0], size=(h, 1)) if opposite else 1.0
    else:
        J = rng.normal(size=(h, nv))
        J *= np.sign(J[:, :1])
    M = np.eye(nv)
    if inertia == 1:
        M = np.diag(10.0 ** rng.uniform(-6, 6, nv))
    elif inertia == 2:
        M = spd(rng, nv, 10.0 ** rng.uniform(0, 12))
    elif rng.uniform() < 0.5:
        J = J * 10.0 ** rng.uniform(-3, 3, nv)
    if rng.uniform() < 0.5:
        J = J * 10.0 ** rng.uniform(-3, 3, (h, 1))
    v = rng.normal(size=nv)
    if speed == 1:
        v *= 10.0 ** rng.uniform(-3, 3, nv)
    elif speed > 1:
        rows, still = np.linalg.matrix_rank(J), np.linalg.svd(J)[2]
        v = -np.linalg.lstsq(J, np.abs(rng.normal(size=h)) * np.linalg.norm(J, axis=1), rcond=None)[0]
        if speed == 3:
            v = 10.0 ** rng.uniform(-12, 0) * v + rng.normal(size=nv - rows) @ still[rows:]
    return Collision(M, J, v)


def wanted(law: Law, c: Collision) -> np.ndarray:
    """gamma^h by definition."""
    if isinstance(law, Poisson):
        return np.zeros(len(c.labels))
    if isinstance(law, LinearMap):
        return c.jacobian @ (np.asarray(law.h) @ c.pre_velocity)
    if isinstance(law, RestitutionLaw):
        return -law.restitution_matrix(c) @ c.pre_contact_velocity
    return law.target(c).contact_velocity


def least_impulse(law: Law, impact: Impact) -> np.ndarray:
    """What the law gives each contact anyway, by definition: ``(1 + e) Lambda_C`` under Poisson's."""
    if not isinstance(law, Poisson):
        return np.zeros(len(impact.collision.labels))
    assert impact.compression is not None
    return (1.0 + law.coefficients(impact.collision)) * impact.compression.impulse


def whitened_gradients(c: Collision) -> np.ndarray:
    """``Y = J L^-T``, ``M = L L^T``, by forward substitution."""
    L = np.linalg.cholesky(c.mass_matrix)
    X = np.zeros_like(c.jacobian.T)
    for i, row in enumerate(L):
        X[i] = (c.jacobian.T[i] - row[:i] @ X[:i]) / row[i]
    return X.T


class Certificate:
    """How far an impact is from its law, each relative to the larger of |v-| and |v+| in the kinetic metric.

    Attributes:
        momentum: of ``M (v+ - v-) - J^T Lambda``, less what rounding to doubles makes of it: that of the impulses, of
            the sum of their lengths; that of M, of the jump: v+ from a factor of M solves a problem with another M,
            and the difference counts in the dual kinetic norm by the condition number.
        complementarity: of ``min(Lambda_i |g_i|, (gamma+_i - gamma^h_i) / |g_i|)``, the largest; Lambda beyond what
            the law gives anyway, and less the rounding of that.

    Both are those of the compression where there is one, if that is worse.
    """

    def __init__(self, impact: Impact, law: Law):
        c = impact.collision
        L = np.linalg.cholesky(c.mass_matrix)
        Y = whitened_gradients(c)
        lengths = np.linalg.norm(Y, axis=1)
        moves = lengths > 0
        jump = L.T @ (impact.post_velocity - c.pre_velocity)
        speed = max(np.linalg.norm(L.T @ c.pre_velocity), np.linalg.norm(L.T @ impact.post_velocity), 1e-300)
        condition = np.finfo(float).eps * np.linalg.cond(c.mass_matrix) if np.count_nonzero(L) > len(L) else 0.0
        rounding = 1e-14 * np.sum(impact.impulse * lengths) + condition * np.linalg.norm(jump)
        error = np.linalg.norm(jump - Y.T @ impact.impulse) - rounding
        self.momentum = max(0.0, error) / speed
        slack = (c.jacobian @ impact.post_velocity - wanted(law, c))[moves] / lengths[moves]
        free = impact.impulse - least_impulse(law, impact)
        free[np.abs(free) <= 1e-15 * impact.impulse] = 0.0
        natural = np.minimum((free * lengths)[moves], slack)
        self.complementarity = np.abs(natural).max(initial=0.0) / speed
        if impact.compression is not None:
            first = Certificate(impact.compression, MaximalDissipation())
            self.momentum = max(self.momentum, first.momentum)
            self.complementarity = max(self.complementarity, first.complementarity)


def assert_certified(impact: Impact, law: Law):
    certificate = Certificate(impact, law)
    assert certificate.complementarity < 1e-9
    assert certificate.momentum < 1e-9
    assert impact.residual < 1e-9
    assert (impact.impulse >= 0).all()


def assert_nearest_in_cone(rows: np.ndarray, point: np.ndarray, weights: np.ndarray):
    """Of the nonnegative combinations of the rows; the rest is orthogonal to it and points out of the cone."""
    nearest = weights @ rows
    assert (weights >= 0).all()
    assert (rows @ (point - nearest) <= 1e-12).all()
    assert abs((point - nearest) @ nearest) <= 1e-12


def energy(c: Collision, v: np.ndarray) -> float:
    return 0.5 * v @ c.mass_matrix @ v


def is_ray(nu: np.ndarray, c: Collision, law: Law, tol: float = 1e-9) -> bool:
    """Whether nu proves that ``J v >= gamma^h`` has no solution: nu >= 0, J^T nu = 0, nu^T (gamma^h - gamma-) > 0."""
    Y = whitened_gradients(c)
    balanced = np.linalg.norm(nu @ Y) <= tol * np.sum(nu * np.linalg.norm(Y, axis=1))
    return bool((nu >= 0).all() and nu.any() and balanced and nu @ (wanted(law, c) - c.pre_contact_velocity) > 0)


def exact_velocity(c: Collision, target: np.ndarray, least: np.ndarray | None = None) -> np.ndarray:
    """v+ of a law in rational arithmetic, by trying every set of active contacts; for few contacts.

    ``least``, (h,), is an impulse that acts anyway.
    """
    M, J, v, wanted = (_rational(a) for a in (c.mass_matrix, c.jacobian, c.pre_velocity[:, None], target[:, None]))
    h = len(J)
    W = _solve(M, J.T)  # M^-1 J^T
    if least is not None:
        v = v + W.dot(_rational(least[:, None]))
    G, b = J.dot(W), wanted - J.dot(v)
    rounding = Fraction(1, 10**12) * max(abs(wanted[:, 0]), default=Fraction(0))  # of gamma^h, which came in as doubles
    for active in chain.from_iterable(combinations(range(h), k) for k in range(h + 1)):
        lam = np.full((h, 1), Fraction(0))
        if active:
            solved = _solve(G[np.ix_(active, active)], b[list(active)])
            if solved is None or (solved < 0).any():
                continue
            lam[list(active)] = solved
        if (G.dot(lam) >= b - rounding).all():
            return (v + W.dot(lam))[:, 0].astype(float)
    raise AssertionError("the law has no solution")


def _rational(a: np.ndarray) -> np.ndarray:
    return np.array([Fraction(x) for x in a.ravel()], dtype=object).reshape(a.shape)


def _solve(A: np.ndarray, B: np.ndarray) -> np.ndarray | None:
    """Gauss-Jordan elimination; None where A is singular."""
    n = len(A)
    T = np.hstack([A, B])
    for i in range(n):
        pivot = next((k for k in range(i, n) if T[k, i] != 0), None)
        if pivot is None:
            return None
        T[[i, pivot]] = T[[pivot, i]]
        T[i] = T[i] / T[i, i]
        for k in range(n):
            if k != i and T[k, i] != 0:
                T[k] = T[k] - T[k, i] * T[i]
    return T[:, n:]


def least_norm_error(impulse: np.ndarray, tight: np.ndarray, J: np.ndarray) -> float:
    """Distance from the conditions of least norm: ``Lambda_i = J_i mu`` where positive, ``J_i mu <= 0`` where zero."""
    A, x = J[tight], impulse[tight]
    zero = x <= 0
    surplus = np.zeros((len(A), int(zero.sum())))
    surplus[zero] = np.eye(int(zero.sum()))
    lengths = np.linalg.norm(A, axis=1)
    rows = np.hstack([A, -A, surplus]) / lengths[:, None]
    return nnls(rows, x / lengths, maxiter=10_000)[1] / np.linalg.norm(x / lengths)


def sparse_chain(masses, velocities) -> Collision:
    """Touching balls on a line, M and J sparse."""
    n = len(masses)
    J = scipy.sparse.diags_array([-np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n))
    return Collision(scipy.sparse.diags_array(np.asarray(masses, dtype=float)), J, velocities)


def disks(side: int, rng: np.random.Generator, holes: float = 0.1, compression: float = 1.0) -> Collision:
    """Disks of random mass on a triangular lattice, of which some are missing; about three contacts each.

    They move towards the middle and at random. Without holes there are more contacts than degrees of freedom.
    """
    i, j = (a.ravel() for a in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    x = np.stack([j + 0.5 * (i % 2), i * np.sqrt(3) / 2], axis=1)[rng.random(side * side) >= holes]
    pairs = np.argwhere(np.triu(np.linalg.norm(x[:, None] - x, axis=2) < 1 + 1e-9, k=1))
    normal = x[pairs[:, 1]] - x[pairs[:, 0]]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    columns = (2 * pairs[:, :, None] + np.arange(2)).reshape(-1)
    rows = np.repeat(np.arange(len(pairs)), 4)
    J = scipy.sparse.coo_array((np.hstack([-normal, normal]).ravel(), (rows, columns)), shape=(len(pairs), 2 * len(x)))
    v = rng.normal(size=x.shape) - compression * (x - x.mean(axis=0))
    return Collision(scipy.sparse.diags_array(np.repeat(rng.uniform(0.5, 2.0, len(x)), 2)), J, v.ravel())


def friction_problem(rng: np.random.Generator, most: int = 12, ratio: float = 1e6):
    """Whitened gradients, offset, rows per contact and speed of boxes that touch each other and the ground.

    Up to ``most`` contacts without friction, with sliding, torsional and rolling friction, coefficients 0.01 to 2,
    masses up to a ratio apart; some boxes stand flat on four corners, so that contacts are redundant.
    """
    h = int(rng.integers(1, most + 1))
    bodies = int(rng.integers(1, h // 2 + 2))
    mass = ratio ** rng.uniform(-0.5, 0.5, bodies) if rng.random() < 0.5 else rng.uniform(0.5, 2.0, bodies)
    size = rng.uniform(0.2, 1.0, bodies)
    flat = rng.random() < 0.4
    blocks, sizes = [], []
    for k in range(h):
        i, j = int(rng.integers(bodies)), int(rng.integers(-1, bodies))
        normal = np.array([0.0, 0.0, 1.0]) if flat else rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        corner = np.array([2.0 * (k % 2) - 1.0, 2.0 * (k // 2 % 2) - 1.0, -1.0])
        frame = np.linalg.qr(np.column_stack([normal, rng.normal(size=(3, 2))]))[0].T
        frame[0] = normal
        d = int(rng.choice([0, 2, 3, 5], p=[0.1, 0.6, 0.15, 0.15]))
        mu = 10.0 ** rng.uniform(-2.0, 0.3)
        block = np.zeros((6, 6 * bodies))
        for body, sign in ((i, 1.0), (j if j != i else -1, -1.0)):
            if body >= 0:
                arm = size[body] * (sign * corner if flat else -sign * normal + 0.2 * rng.normal(size=3))
                at = 6 * body
                block[:3, at : at + 3] += sign * frame
                block[:3, at + 3 : at + 6] += sign * np.cross(arm, frame)
                block[3:, at + 3 : at + 6] += sign * frame
        blocks.append((block * np.array([1.0, mu, mu, 0.1 * mu, 0.03 * mu, 0.03 * mu])[:, None])[: d + 1])
        sizes.append(d + 1)
    inertia = np.concatenate([[m] * 3 + [0.4 * m * s**2] * 3 for m, s in zip(mass, size, strict=True)])
    A, sizes = np.vstack(blocks) / np.sqrt(inertia), np.array(sizes)
    normals = A[np.cumsum(sizes) - sizes]
    z = rng.normal(size=A.shape[1])
    if rng.random() < 0.6:
        closing = np.abs(rng.normal(size=h)) * np.linalg.norm(normals, axis=1)
        z = 0.5 * z - np.linalg.lstsq(normals, closing, rcond=None)[0]
    return A, A @ z, sizes, float(np.linalg.norm(z))


def friction_collision(rng: np.random.Generator, most: int = 12, ratio: float = 1e6) -> Collision:
    """The collision of `friction_problem`, in whitened coordinates; every contact has friction."""
    A, _, sizes, speed = friction_problem(rng, most, ratio)
    first = np.cumsum(sizes) - sizes
    normal = np.zeros(len(A), dtype=bool)
    normal[first] = True
    contact = np.repeat(np.arange(len(sizes)), sizes)[~normal]
    lengths = np.linalg.norm(A[~normal], axis=1)
    mu = 10.0 ** rng.uniform(-2.0, 0.3, len(contact))
    friction = Friction(A[~normal] / np.where(lengths > 0, lengths, 1.0)[:, None], contact, mu)
    v = rng.normal(size=A.shape[1])
    return Collision(np.eye(A.shape[1]), A[first], v * speed / np.linalg.norm(v), friction=friction)
