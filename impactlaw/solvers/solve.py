"""From a problem to its impulse: choose a solver, certify its answer, share it among redundant contacts."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lstsq
from scipy.optimize import nnls as _nnls

from impactlaw.errors import SolverError, UnknownNameError, UnsolvableLawError
from impactlaw.solvers.base import Problem, Solver, Status
from impactlaw.solvers.closed_form import closed_form
from impactlaw.solvers.dual_active_set import dual_active_set
from impactlaw.solvers.least_norm import least_norm
from impactlaw.solvers.nnls import cone_projection, nnls

SOLVERS: dict[str, Solver] = {
    "closed-form": closed_form,
    "nnls": nnls,
    "dual-active-set": dual_active_set,
}
"""The registry: a new solver is one file and one line here."""

CERTIFIED = 1e-9
"""Residual, relative to the largest wanted velocity change, above which an answer is not one."""
_POLISHED = 1e-13  # residual that needs no second look
_TIGHT = 1e-9  # slack, relative to the jump, of a contact that may share the impulse


def solve(problem: Problem, labels: tuple[str, ...], *, solver: str = "auto") -> np.ndarray:
    """Return the impulse of least norm that solves the problem, shape (h,).

    Args:
        problem: what to solve.
        labels: names of the contacts, for messages.
        solver: a name from `SOLVERS`, or "auto": closed form for one contact, NNLS where the law knows a velocity with
            the wanted contact velocities, a dual active set otherwise, each the fallback of the other.

    Raises:
        UnknownNameError: no such solver.
        UnsolvableLawError: the problem has no solution.
        SolverError: no solver's answer passed the certificate.
    """
    size = float(np.abs(problem.slack(np.zeros(problem.gradients.shape[1]))).max(initial=0.0))
    if size == 0.0 or (problem.bound <= 0).all():
        return np.zeros_like(problem.bound)
    _refuse_fixed(problem, labels)
    best, error, status = None, np.inf, Status.STOPPED
    for name in _candidates(problem, solver):
        solution = SOLVERS[name](problem)
        status = solution.status
        if status is Status.INFEASIBLE:
            ray = farkas_ray(problem)
            if ray is not None:
                raise UnsolvableLawError([labels[i] for i in np.flatnonzero(ray)], ray)
            continue
        if status is Status.STOPPED and not solution.impulse.any():
            continue
        impulse, residual = _polish(problem, solution.impulse)
        if residual < error:
            best, error = impulse, residual
        if error <= CERTIFIED * size:
            break
    if best is None or error > CERTIFIED * size:
        ray = farkas_ray(problem)
        if ray is not None:
            raise UnsolvableLawError([labels[i] for i in np.flatnonzero(ray)], ray)
        raise SolverError(
            f"solver {solver!r} ended {status} with relative residual {error / size:.1e} on {len(labels)} contacts; "
            "try another solver, or check the scene for contacts of very different scale"
        )
    return _share(problem, best, error, size)


def nonnegative_combination(gradients: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Least-norm ``Lambda >= 0`` that minimises ``|Y^T Lambda - point|``, shape (h,)."""
    if len(gradients) == 0:
        return np.zeros(0)
    problem = Problem(gradients, gradients @ point, point)
    impulse = cone_projection(gradients, point, problem.norms).impulse
    size = float(np.linalg.norm(point))
    return _share(problem, impulse, problem.residual(impulse), size) if size > 0 else impulse


def farkas_ray(problem: Problem) -> np.ndarray | None:
    """Return ``nu >= 0`` with ``Y^T nu = 0`` and ``c^T nu > 0``, a proof that ``Y z >= c`` has no solution, or None."""
    scale = np.where(problem.moving, problem.norms, 1.0)
    Y, c = problem.gradients / scale[:, None], problem.bound / scale
    c = c / np.abs(c).max()
    h = len(c)
    nu, _ = _nnls(np.vstack([Y.T, c]), np.concatenate([np.zeros(Y.shape[1]), [1.0]]), maxiter=100 * h)
    if not nu.any() or np.linalg.norm(nu @ Y) > 1e-9 * nu.sum() or nu @ c < 1e-7 * nu.sum():
        return None
    nu[nu < 1e-9 * nu.max()] = 0.0
    return nu / scale


def _candidates(problem: Problem, solver: str) -> tuple[str, ...]:
    if solver != "auto":
        if solver not in SOLVERS:
            raise UnknownNameError("solver", solver, [*SOLVERS, "auto"])
        return (solver,)
    if len(problem.bound) == 1:
        return ("closed-form",)
    return ("nnls", "dual-active-set") if problem.preimage is not None else ("dual-active-set", "nnls")


def _refuse_fixed(problem: Problem, labels: tuple[str, ...]) -> None:
    """A contact whose gradient is zero cannot change its velocity: wanting it to is a conflict of its own."""
    wanted = ~problem.moving & (problem.bound > 0)
    if wanted.any():
        ray = wanted.astype(float)
        raise UnsolvableLawError([labels[i] for i in np.flatnonzero(wanted)], ray)


def _polish(problem: Problem, impulse: np.ndarray) -> tuple[np.ndarray, float]:
    """Solve once more on the contacts that carry an impulse, and keep what has the smaller residual."""
    residual = problem.residual(impulse)
    scaled = impulse * problem.norms
    top = scaled.max(initial=0.0)
    if residual <= _POLISHED * top:
        return impulse, residual
    active = scaled > 1e-10 * top
    if not active.any():
        return impulse, residual
    scale = problem.norms[active]
    Y = problem.gradients[active] / scale[:, None]
    z = lstsq(Y, problem.bound[active] / scale, check_finite=False)[0]
    better = np.zeros_like(impulse)
    better[active] = lstsq(Y.T, z, check_finite=False)[0] / scale
    for _ in range(2):
        error = problem.bound[active] - problem.gradients[active] @ (better @ problem.gradients)
        dz = lstsq(Y, error / scale, check_finite=False)[0]
        better[active] += lstsq(Y.T, dz, check_finite=False)[0] / scale
    better = np.maximum(better, 0.0)
    polished = problem.residual(better)
    return (better, polished) if polished < residual else (impulse, residual)


def _share(problem: Problem, impulse: np.ndarray, residual: float, size: float) -> np.ndarray:
    """Share the impulse among redundant contacts (least norm), unless that costs digits of the certificate."""
    carries = impulse > 0
    if not carries.any():
        return impulse
    tight = carries | (np.abs(problem.slack(impulse @ problem.gradients)) <= _TIGHT * size)
    if np.count_nonzero(tight) < 2:
        return impulse
    shared = least_norm(problem.gradients, impulse, tight)
    if shared is impulse:
        return impulse
    return shared if problem.residual(shared) <= max(10 * residual, 1e-12 * size) else impulse
