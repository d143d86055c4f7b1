"""Checks whether an impact obeys its law, without any part of the implementation."""

from fractions import Fraction
from itertools import chain, combinations

import numpy as np
from scipy.optimize import nnls

from impactlaw import Collision, Impact, Law, LinearMap, MaximalDissipation, Poisson
from impactlaw.laws import RestitutionLaw


def wanted(law: Law, c: Collision) -> np.ndarray:
    """Return gamma^h by definition."""
    if isinstance(law, Poisson):
        return np.zeros(len(c.labels))
    if isinstance(law, LinearMap):
        return c.jacobian @ (np.asarray(law.h) @ c.pre_velocity)
    if isinstance(law, RestitutionLaw):
        return -law.restitution_matrix(c) @ c.pre_contact_velocity
    return law.target(c).contact_velocity


def least_impulse(law: Law, impact: Impact) -> np.ndarray:
    """Return the impulses that the law applies in any case: ``(1 + e) Lambda_C`` under Poisson's law."""
    if not isinstance(law, Poisson):
        return np.zeros(len(impact.collision.labels))
    assert impact.compression is not None
    return (1.0 + law.coefficients(impact.collision)) * impact.compression.impulse


def whitened_gradients(c: Collision) -> np.ndarray:
    """Return ``Y = J L^-T``, ``M = L L^T``, by forward substitution."""
    L = np.linalg.cholesky(c.mass_matrix)
    X = np.zeros_like(c.jacobian.T)
    for i, row in enumerate(L):
        X[i] = (c.jacobian.T[i] - row[:i] @ X[:i]) / row[i]
    return X.T


class Certificate:
    """The errors of an impact with respect to its law, relative to the larger of |v-| and |v+| in the kinetic metric.

    Attributes:
        momentum: norm of ``M (v+ - v-) - J^T Lambda``, less the effect of rounding to doubles. Rounding of impulses is
            relative to the sum of their lengths. Rounding of M is relative to the jump: v+ from a factor of M solves a
            problem with a slightly different M, and the difference counts in the dual kinetic norm by the condition
            number.
        complementarity: largest ``min(Lambda_i |g_i|, (gamma+_i - gamma^h_i) / |g_i|)``, where Lambda is the impulse
            beyond the one that the law applies in any case, up to its rounding.

    If the impact has a compression phase, both are at least the errors of this phase.
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
    """Assert that the weighted sum of the rows is the point of their cone nearest to a point: the rest points out."""
    nearest = weights @ rows
    assert (weights >= 0).all()
    assert (rows @ (point - nearest) <= 1e-12).all()
    assert abs((point - nearest) @ nearest) <= 1e-12


def is_ray(nu: np.ndarray, c: Collision, law: Law, tol: float = 1e-9) -> bool:
    """Return whether nu proves ``J v >= gamma^h`` unsolvable: nu >= 0, J^T nu = 0, nu^T (gamma^h - gamma-) > 0."""
    Y = whitened_gradients(c)
    balanced = np.linalg.norm(nu @ Y) <= tol * np.sum(nu * np.linalg.norm(Y, axis=1))
    return bool((nu >= 0).all() and nu.any() and balanced and nu @ (wanted(law, c) - c.pre_contact_velocity) > 0)


def exact_velocity(c: Collision, target: np.ndarray, least: np.ndarray | None = None) -> np.ndarray:
    """Return v+ of a law in rational arithmetic, by trying every set of active contacts; for few contacts.

    ``least``, (h,), is an impulse that acts in any case.
    """
    M, J, v, wanted = (_rational(a) for a in (c.mass_matrix, c.jacobian, c.pre_velocity[:, None], target[:, None]))
    h = len(J)
    W = _solve(M, J.T)  # M^-1 J^T
    if least is not None:
        v = v + W.dot(_rational(least[:, None]))
    G, b = J.dot(W), wanted - J.dot(v)
    rounding = Fraction(1, 10**12) * max(abs(wanted[:, 0]), default=Fraction(0))  # of gamma^h, given in doubles
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
    """Solve by Gauss-Jordan elimination; return None if A is singular."""
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
    """Return the violation of the least-norm conditions: ``Lambda_i = J_i mu`` if positive, ``J_i mu <= 0`` if zero."""
    A, x = J[tight], impulse[tight]
    zero = x <= 0
    surplus = np.zeros((len(A), int(zero.sum())))
    surplus[zero] = np.eye(int(zero.sum()))
    lengths = np.linalg.norm(A, axis=1)
    rows = np.hstack([A, -A, surplus]) / lengths[:, None]
    return nnls(rows, x / lengths, maxiter=10_000)[1] / np.linalg.norm(x / lengths)
