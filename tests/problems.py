"""Collisions and laws shared by several test files."""

from collections.abc import Callable

import numpy as np
import scipy.sparse

from impactlaw import Collision, Fremond, Law, LinearMap, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.laws.registry import REGISTERED


def balls(masses, velocities) -> Collision:
    """Return touching balls on a line, gamma_i = v_{i+1} - v_i."""
    n = len(masses)
    return Collision(np.diag(np.asarray(masses, dtype=float)), np.diff(np.eye(n), axis=0), velocities)


def launched(n: int, k: int) -> Collision:
    """Return n equal balls of which the first k come in with velocity 1."""
    return balls(np.ones(n), (np.arange(n) < k).astype(float))


def rod() -> Collision:
    """Return a uniform rod of mass 1 and length 2 that lands flat with velocity 1 on supports under its two ends."""
    return Collision(np.diag([1.0, 1.0 / 3.0]), [[1.0, -1.0], [1.0, 1.0]], [-1.0, 0.0])


def box(side: int = 2, tilt: float = 0.0) -> Collision:
    """Return a cube of mass 2 and half edge 1 that lands with velocity 1 on side x side points of its bottom face."""
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

"""Laws for some collisions only, or with random outcomes; `laws/test_registry.py` and files of their own test them."""

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

for _law in REGISTERED:  # a new law is tested on every problem, as `make_law` makes it
    if _law.name not in OF_SOME and not any(title.startswith(_law.name.split("-")[0]) for title in LAWS):
        LAWS[_law.name] = lambda c, law=_law: law.of(0.5)


def spd(rng: np.random.Generator, n: int, condition: float) -> np.ndarray:
    """Return a random symmetric matrix whose eigenvalues span the condition number."""
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    d = np.exp(rng.uniform(-0.5, 0.5, n) * np.log(condition))
    d[: min(n, 2)] = [condition**-0.5, condition**0.5][: min(n, 2)]
    M = (Q * d) @ Q.T
    return 0.5 * (M + M.T)


def random_collision(rng: np.random.Generator, most: int = 64) -> Collision:
    """Return up to ``most`` random contacts.

    Masses are 1e-6 to 1e6, or condition numbers up to 1e12. Gradients may be dependent, duplicated, nearly parallel or
    opposite. Rows, and columns where the masses are equal, are scaled by 1e-3 to 1e3. Some collisions are fast, some
    slow, and in some all contacts close.
    """
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


def energy(c: Collision, v: np.ndarray) -> float:
    return 0.5 * v @ c.mass_matrix @ v


def sparse_chain(masses, velocities) -> Collision:
    """Return touching balls on a line, with sparse M and J."""
    n = len(masses)
    J = scipy.sparse.diags_array([-np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n))
    return Collision(scipy.sparse.diags_array(np.asarray(masses, dtype=float)), J, velocities)


def disks(side: int, rng: np.random.Generator, holes: float = 0.1, compression: float = 1.0) -> Collision:
    """Return disks of random mass on a triangular lattice with holes; about three contacts each.

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
