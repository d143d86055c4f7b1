"""From a problem to its impulse: choose a solver, certify its answer, share it among redundant contacts."""

from __future__ import annotations

import numpy as np

from impactlaw import deferred
from impactlaw.errors import SolverError, UnknownNameError, UnsolvableLawError
from impactlaw.solvers.certificate import Answer, is_polishable, judge, polish
from impactlaw.solvers.guess import guess
from impactlaw.solvers.infeasibility import farkas_ray
from impactlaw.solvers.least_norm import share_impulse
from impactlaw.solvers.methods.closed_form import closed_form, one_contact
from impactlaw.solvers.methods.dual_active_set import dual_active_set
from impactlaw.solvers.methods.least_distance import least_distance
from impactlaw.solvers.methods.nnls import nnls
from impactlaw.solvers.methods.osqp import osqp
from impactlaw.solvers.methods.primal_dual_active_set import primal_dual_active_set
from impactlaw.solvers.methods.projected_gauss_seidel import projected_gauss_seidel
from impactlaw.solvers.one_thread import one_thread
from impactlaw.solvers.problem import FEW, Problem, Solution, Solver, Status, sparse
from impactlaw.solvers.sparsity import as_dense, groups, has_structure

SOLVERS: dict[str, Solver] = {
    "closed-form": closed_form,
    "nnls": nnls,
    "dual-active-set": dual_active_set,
    "primal-dual-active-set": primal_dual_active_set,
    "least-distance": least_distance,
    "osqp": osqp,
    "projected-gauss-seidel": projected_gauss_seidel,
}
"""The registry: a new solver is one file and one line here."""

_ITERATIVE = {"osqp", "projected-gauss-seidel"}
_TAKE_SPARSE = {"primal-dual-active-set", *_ITERATIVE}

CERTIFIED = 1e-9
"""Residual, relative to the velocities before and after, above which an answer is not one."""
_GOOD = 1e-12  # relative residual that needs no other solver's opinion
_GOOD_LARGE = 1e-10  # the same where another's opinion, that of a dense solver, takes seconds
_MANY = 64  # contacts from which linear algebra starts threads where it may
_TIGHT = 1e-9  # slack, relative to the scale of the problem, of a contact that may share the impulse
_RANKS = (1e-13, 1e-11, 1e-9)  # relative singular values below which a direction of the gradients may be rounding


def solve(problem: Problem, labels: tuple[str, ...], *, solver: str = "auto") -> np.ndarray:
    """Return the impulse of least norm that solves the problem, shape (h,); see `solve_with_jump`."""
    return solve_with_jump(problem, labels, solver=solver).impulse


def solve_with_jump(problem: Problem, labels: tuple[str, ...], *, solver: str = "auto", shared: bool = True) -> Answer:
    """Return the impulse of least norm that solves the problem, and its velocity jump.

    Args:
        problem: what to solve.
        labels: names of the contacts, for messages.
        solver: a name from `SOLVERS`, or "auto": closed form for one contact, NNLS where the law knows a velocity with
            the wanted contact velocities, a dual active set otherwise, the others where an answer is not certified.
        shared: whether redundant contacts share the impulse; if not, it is any that solves the problem. The jump is
            the same.

    Raises:
        UnknownNameError: no such solver.
        UnsolvableLawError: the problem has no solution.
        SolverError: no solver's answer passed the certificate.
    """
    if solver != "auto" and solver not in SOLVERS:
        raise UnknownNameError("solver", solver, [*SOLVERS, "auto"])
    c = problem.bound
    if (max(c.tolist()) if 0 < len(c) <= FEW else c.max(initial=0.0)) <= 0.0:
        return Answer(np.zeros(len(c)), np.zeros(problem.gradients.shape[1]), -c / problem.lengths, 0.0)
    if len(c) < _MANY:
        return _solve(problem, labels, solver, shared=shared)
    with one_thread():
        return _solve(problem, labels, solver, shared=shared)


def _solve(problem: Problem, labels: tuple[str, ...], solver: str, *, shared: bool) -> Answer:
    """Return what `solve_with_jump` returns where there is something to solve."""
    c = problem.bound
    if problem.lengths is not problem.norms:
        return _solve_moving(problem, labels, solver)
    if solver == "auto":
        if len(c) > FEW and has_structure(problem):
            problem = problem.with_gradients(sparse(problem.gradients))
        answer = None if problem.is_sparse else _at_once(problem)
        if answer is not None and _is_good(problem, answer):
            return share(problem, answer) if shared else answer
    if solver != "auto" and not problem.is_sparse:
        parts = groups(problem)
        if len(parts) > 1:
            return _solve_apart(problem, labels, solver, parts)
    ended: list[Solution] = []
    answer = _attempt(problem, solver, labels, ended)
    if not _certified(problem, answer):
        if solver not in _ITERATIVE:
            answer = _better(answer, _attempt_in_row_space(problem, solver))
        if solver == "auto":  # what nobody can solve may be rounding
            answer = _better(answer, judge(problem, np.zeros_like(c)))
        if answer is None or not _certified(problem, answer):
            _refuse(problem, labels)
            reached = "no answer" if answer is None else f"relative residual {answer.residual / problem.scale:.1e}"
            if solver in _ITERATIVE:
                last = ended[-1]
                reached += f" (status {last.status}, {last.iterations} iterations, residual {last.residual:.1e})"
            raise SolverError(
                f"solver {solver!r} reached {reached} on {len(labels)} contacts; "
                "try another solver, or check the scene for contacts of very different scale, or opposite to each other"
            )
    assert answer is not None
    return share(problem, answer) if shared else answer


def _is_good(problem: Problem, answer: Answer) -> bool:
    return answer.residual <= _GOOD * problem.speed or answer.residual <= _GOOD * problem.scale  # |v-| is part of it


def _at_once(problem: Problem) -> Answer | None:
    """Return what solves most problems; None where only a solver can tell."""
    if len(problem.bound) == 1:
        return one_contact(problem)
    impulse = guess(problem)
    return None if impulse is None else polish(problem, impulse)


def nonnegative_combination(gradients: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the ``Lambda >= 0`` of least norm that minimises ``|Y^T Lambda - point|``, shape (h,).

    Args:
        gradients: ``Y``, shape (h, nv).
        point: shape (nv,).

    Raises:
        SolverError: no solver's answer passed the certificate.
    """
    return solve(Problem(gradients, gradients.dot(point), point), ("",) * gradients.shape[0])


def _attempt(
    problem: Problem, solver: str, labels: tuple[str, ...] | None, ended: list[Solution] | None = None
) -> Answer | None:
    """Ask one solver after the other until an answer is good; return the best. Labels given, refuse the unsolvable.

    What each solver handed back is put into ``ended``.
    """
    best = None
    enough = (_GOOD if is_polishable(problem) else _GOOD_LARGE) * problem.scale
    for name in _candidates(problem, solver):
        form = problem if name in _TAKE_SPARSE else as_dense(problem)
        if form is None:
            continue
        solution = SOLVERS[name](form)
        if ended is not None:
            ended.append(solution)
        if solution.status is Status.INFEASIBLE and labels is not None:
            _refuse(problem, labels)
        if solution.status is not Status.SOLVED and name not in _ITERATIVE:
            continue
        best = _better(best, polish(problem, solution.impulse))
        if best is not None and best.residual <= enough:
            break
    return best


def _attempt_in_row_space(problem: Problem, solver: str) -> Answer | None:
    """Try without directions in which the gradients are nothing but rounding, or almost; return the best."""
    best, dense = None, as_dense(problem)
    if dense is None:
        return None
    problem = dense
    _, singular, V = deferred.svd(problem.gradients / problem.lengths[:, None], full_matrices=False, check_finite=False)
    ranks = {int(np.count_nonzero(singular > small * singular[0])) for small in _RANKS}
    for rank in sorted(ranks - {len(singular)}, reverse=True):
        basis = V[:rank]
        d = None if problem.preimage is None else basis.dot(problem.preimage)
        part = Problem(problem.gradients.dot(basis.T), problem.bound, d, problem.scale)
        answer = _attempt(part, solver, None)
        if answer is not None:
            best = _better(best, judge(problem, answer.impulse, answer.jump.dot(basis)))
    return best


def _certified(problem: Problem, answer: Answer | None) -> bool:
    if answer is None:
        return False
    limit, residual = CERTIFIED * problem.speed, answer.residual
    return residual <= limit or residual <= CERTIFIED * problem.speed_at(answer.jump)


def _better(one: Answer | None, other: Answer | None) -> Answer | None:
    if one is None or other is None:
        return other if one is None else one
    return one if one.residual <= other.residual else other


def _candidates(problem: Problem, solver: str) -> tuple[str, ...]:
    if solver != "auto":
        return (solver,)
    if problem.is_sparse:
        return ("primal-dual-active-set", "nnls", "dual-active-set", "least-distance")
    if len(problem.bound) == 1:
        return ("closed-form",)
    if problem.preimage is not None:
        return ("nnls", "dual-active-set", "least-distance")
    return ("dual-active-set", "least-distance", "nnls")


def _solve_moving(problem: Problem, labels: tuple[str, ...], solver: str) -> Answer:
    """Leave out contacts whose gradient is zero; wanting their velocity to change is a conflict of its own."""
    moving = problem.norms > 0
    wanted = ~moving & (problem.bound > 0)
    if wanted.any():
        raise UnsolvableLawError([labels[i] for i in np.flatnonzero(wanted)], wanted.astype(float))
    part = Problem(problem.gradients[moving], problem.bound[moving], problem.preimage, problem.speed)
    answer = solve_with_jump(part, tuple(np.array(labels)[moving]), solver=solver)
    impulse, slack = np.zeros_like(problem.bound), -problem.bound
    impulse[moving], slack[moving] = answer.impulse, answer.slack
    return Answer(impulse, answer.jump, slack, answer.residual)


def _solve_apart(problem: Problem, labels: tuple[str, ...], solver: str, parts: list[np.ndarray]) -> Answer:
    """Solve each group of contacts on its own, so that the speed of one does not excuse the errors of another."""
    impulse, jump = np.zeros_like(problem.bound), np.zeros(problem.gradients.shape[1])
    for rows in parts:
        part = Problem(problem.gradients[rows], problem.bound[rows])
        answer = solve_with_jump(part, tuple(labels[i] for i in rows), solver=solver)
        impulse[rows] = answer.impulse
        jump += answer.jump
    return judge(problem, impulse, jump)


def _refuse(problem: Problem, labels: tuple[str, ...]) -> None:
    """Raise if there is a proof that no solution exists; with a preimage there always is one."""
    if problem.preimage is not None:
        return
    dense = as_dense(problem)
    ray = None if dense is None else farkas_ray(dense)
    if ray is not None:
        raise UnsolvableLawError([labels[i] for i in np.flatnonzero(ray)], ray)


def share(problem: Problem, answer: Answer) -> Answer:
    """Share the impulse among redundant contacts (least norm), unless that costs digits of the certificate.

    The contacts that carry an impulse are independent, active-set solvers see to it, so that nothing is to share
    unless one more contact is tight.
    """
    impulse = answer.impulse
    if problem.lengths is not problem.norms or not len(impulse):  # `_solve_moving` has shared it
        return answer
    if not problem.is_sparse and has_structure(problem):
        problem = problem.with_gradients(sparse(problem.gradients))
    if not problem.is_sparse and min((impulse + answer.slack).tolist()) > _TIGHT * problem.scale:  # one or the other
        return answer
    tight = answer.slack <= _TIGHT * problem.scale
    if not problem.is_sparse and np.count_nonzero(tight) <= np.count_nonzero(impulse):
        return answer
    least = share_impulse(problem.gradients, impulse, tight | (impulse > 0))
    if least is impulse:
        return answer
    answer_shared = judge(problem, least, answer.jump)
    return answer_shared if answer_shared.residual <= max(10 * answer.residual, _GOOD * problem.scale) else answer
