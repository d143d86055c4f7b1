"""Solve a problem of contacts with friction: in closed form for one contact, else by the compiled solver."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from impactlaw.solvers.friction.problem import ENOUGH, ConeAnswer, ConeProblem
from impactlaw.solvers.friction.sharing import share
from impactlaw.solvers.friction.single_contact import single
from impactlaw.solvers.one_thread import one_thread
from impactlaw.solvers.problem import Status

_ALONE = 1e-13  # relative residual at which the answer for a single contact needs no Newton step
_SHARP = 1e-13  # residual that the compiled solver aims at, relative to the problem's scale
_AGAIN = 4  # number of starts of a thorough search, each from the best point found before
_WORTH_IT = 0.5  # in haste, start again only if the last start reduced the residual to less than this part
_MUCH = 1e6  # budget in haste, in works of a time step: practically unlimited, but hopeless searches end early
_FACTORS = 1.0, 4.0  # of impulses of the convex problem, as starting points if all else fails
THOROUGH = 24
"""Rounds of slower and safer methods than Newton's, beyond which further rounds have never helped."""
BRIEF = 8
"""Rounds that are worth their time within a step."""
STEPS_OF_A_ROUND = 150
"""Typical number of steps in a round."""


class Effort(Protocol):
    """A budget of work for a collision.

    Attributes:
        hasty: whether to omit restitution at once, instead of scaling it down, if no impulses are found for it; and to
            try little if there is no indication that a solution exists.
    """

    hasty: bool

    def rounds(self, rows: int) -> int:
        """Return the number of rounds allowed for a problem with a number of rows, if Newton's method fails."""
        ...

    def steps(self, rows: int) -> float:
        """Return the total number of steps allowed for such a problem; an attempt that has begun may exceed it.

        Raises if no attempt may begin.
        """
        ...

    def attempt(self, rows: int, steps: int) -> None:
        """Count an attempt and its steps; raise to end the search."""
        ...

    def begin_part(self) -> None:
        """Begin a group of contacts that do not influence the others, and may have a budget of their own."""
        ...


def solve_cones(
    problem: ConeProblem,
    guess: np.ndarray | None = None,
    *,
    rounds: int = THOROUGH,
    most: float = np.inf,
    hasty: bool = False,
) -> ConeAnswer:
    """Solve a problem of contacts with friction.

    A single contact has a closed form, or nearly so (`single_contact.single`), which needs no compiled code. Any other
    problem is solved by the compiled solver (`impactlaw.solvers.cones`): Newton's method from the guess, then from zero
    impulse, and rounds of slower methods if it fails. A thorough search then starts again from the best point, and from
    impulses of the convex problem. In haste, Newton's method is tried alone first, see `cones.jams`. For large
    coefficients of friction there may be several solutions; the same problem always returns the same one.

    Args:
        problem: the problem to solve.
        guess: an impulse near the solution, (n,), such as that of the previous step.
        rounds: largest number of rounds if Newton's method fails.
        most: number of steps after which no further attempt begins.
        hasty: whether to try little if there is no indication that a solution exists, see
            `cones.convex.out_of_reach`.

    Returns:
        The best answer found. Its status is "solved" if its residual is at most 1e-10 of the problem's scale, and
        "infeasible" if a hasty search found that there is no solution.
    """
    if problem.exact and problem.shape[0] == 1:
        x = single(problem, guess)
        if x is not None and (residual := problem.residual(x, problem.velocity(x))) <= _ALONE * problem.scale:
            return problem.answer(x, residual, Status.SOLVED, 0)
    answer = _attempt(problem, guess, rounds, most, hasty)
    total = answer.iterations
    if answer.status is not Status.STOPPED or not problem.exact or rounds <= BRIEF or total >= most:
        return answer
    relaxed = _attempt(problem.relaxed, None, rounds, most - total, hasty)
    total += relaxed.iterations
    for factor in _FACTORS if relaxed.status is Status.SOLVED or not hasty else ():
        if total >= most:
            break
        other = _attempt(problem, factor * relaxed.impulse, rounds, most - total, hasty)
        total += other.iterations
        answer = other if other.residual < answer.residual else answer
    return answer._replace(iterations=total)


def solve_within(problem: ConeProblem, guess: np.ndarray | None, rounds: int, effort: Effort | None) -> ConeAnswer:
    """Call `solve_cones` within the limits of an effort, and count its work there; None means no limit."""
    if effort is None:
        return solve_cones(problem, guess, rounds=rounds)
    rows = problem.start.size
    answer = solve_cones(problem, guess, rounds=effort.rounds(rows), most=effort.steps(rows), hasty=effort.hasty)
    effort.attempt(rows, answer.iterations)
    return answer


def _attempt(problem: ConeProblem, guess: np.ndarray | None, rounds: int, most: float, hasty: bool) -> ConeAnswer:
    """Return the answer of the compiled solver from a guess, started repeatedly from the point that it reached.

    No start begins after `most` steps.
    """
    x, residual, total, part = np.zeros(problem.shape), np.inf, 0, _WORTH_IT if hasty else 1.0
    for k in range(_AGAIN if rounds > BRIEF else 2):
        quick = hasty and k == 0
        found, taken = compiled_answer(problem, guess, 0 if quick else rounds, hasty=hasty)
        total += taken
        with np.errstate(all="ignore"):
            reached = problem.residual(found, problem.velocity(found))
        enough = residual <= ENOUGH * problem.scale  # solved before this start, which could only sharpen the answer
        again = reached >= part * residual < np.inf  # no progress: another start would begin at nearly the same point
        if reached < residual:
            x, residual = found, reached
        hopeless = again or (residual > ENOUGH * problem.scale and rounds <= BRIEF)
        if enough or hopeless or residual <= _ALONE * problem.scale or total >= most:
            break
        if quick and residual > ENOUGH * problem.scale and _jams(problem):
            return problem.answer(x, residual, Status.INFEASIBLE, total)
        guess = problem.unscaled(x)
    status = Status.SOLVED if residual <= ENOUGH * problem.scale else Status.STOPPED
    return problem.answer(x, residual, status, total)


def cost(rows: int, freedoms: int) -> tuple[float, float]:
    """Return the estimated time of a problem before the first step, and per step, ms on one core of an AMD EPYC.

    The estimate is a fit to problems of 6 to 384 rows and 6 to 240 degrees of freedom, within 50 %.
    """
    return 0.1 + 3e-7 * rows**2 * freedoms, 6e-3 + 1.5e-4 * rows + 1e-7 * min(rows, freedoms) ** 3


def compiled_answer(
    problem: ConeProblem, guess: np.ndarray | None, rounds: int, *, hasty: bool = False
) -> tuple[np.ndarray, int]:
    """Return the result of the compiled solver: the scaled impulse, (h, m), and the total number of steps."""
    from impactlaw.compiled import compile_together

    compile_together("impactlaw.solvers.cones.solve")
    from impactlaw.solvers.cones.solve import solve

    n = problem.start.size
    start = np.zeros(n) if guess is None else np.array(problem.scaled(guess), dtype=float).reshape(-1)
    rows, groups = _layout(problem)
    limits = start, problem.exact, _SHARP * problem.scale / problem.largest, rounds, _MUCH if hasty else np.inf
    x, _, _, taken = solve(*rows, problem.rows.shape[1], *groups, *limits)
    return x.reshape(problem.shape), int(taken)


def _jams(problem: ConeProblem) -> bool:
    """Return whether bodies jam, see `cones.jams`."""
    from impactlaw.solvers.cones.jams import jams

    rows, groups = _layout(problem)
    return bool(jams(*rows, *groups, problem.exact))


def _layout(problem: ConeProblem) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return the rows of a problem, and its groups, in the form that compiled functions read."""
    from impactlaw.solvers.cones import CONE

    (h, m), nv = problem.shape, problem.rows.shape[1]
    n = h * m
    begin = np.arange(0, n * nv, nv, dtype=np.int32) if nv else np.zeros(n, np.int32)
    columns = np.tile(np.arange(nv, dtype=np.int32), n)
    rows = np.full(n, nv, np.int32), begin, columns, np.ascontiguousarray(problem.rows).reshape(-1)
    first, size, kind = np.arange(0, n, m, dtype=np.int32), np.full(h, m, np.int32), np.full(h, CONE, np.int32)
    return rows, (np.zeros(nv, np.int32), first, size, kind, np.zeros(h), np.zeros(n), problem.start.flatten())


def shared(problem: ConeProblem, answer: ConeAnswer) -> ConeAnswer:
    """Return the answer with the impulse shared among redundant contacts: the scaled impulse of least norm."""
    x = problem.scaled(answer.impulse)
    with np.errstate(all="ignore"), one_thread():
        least = share(problem, x, answer.residual)
    if least is x:
        return answer
    return problem.answer(least, problem.residual(least, problem.velocity(least)), answer.status, answer.iterations)
