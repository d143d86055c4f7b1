"""Solve every problem by every solver, from the guess and from zero impulses."""

import statistics
import time
from collections.abc import Iterator

import numpy as np

from .problem import Problem
from .solvers import Call, Solver

STARTS = ("guess", "rest")
Row = dict[str, object]
_LONG = 0.02  # s; a longer call is timed once
_BLOCKS, _BLOCK = 3, 5e-4  # number of blocks of calls whose median counts, and the duration of each, s


def warm_up(solvers: list[Solver], problems: list[Problem]) -> None:
    """Let every solver solve the first problem it takes, so that loading and compiling are not timed."""
    for solver in solvers:
        for problem in problems:
            if solver.takes(problem):
                solver.bind(problem, problem.guess)()
                break


def rows_of(number: int, problem: Problem, solvers: list[Solver], most_rows: int) -> Iterator[Row]:
    """Yield one row per solver and start.

    Columns: problem, its number; scene, rows, singular; solver, start; missed, the natural map; us, processor time in
    microseconds; iterations; slides, whether a contact that carries an impulse slides.
    """
    about = {"problem": number, "scene": problem.scene, "rows": len(problem.offset), "singular": problem.is_singular()}
    for solver in solvers:
        if not solver.takes(problem) or not (solver.any_size or len(problem.offset) <= most_rows):
            continue
        for start in STARTS:
            guess = problem.guess if start == "guess" else np.zeros(len(problem.offset))
            (x, iterations), spent = _timed(solver.bind(problem, guess))
            yield about | {
                "solver": solver.name, "start": start, "missed": problem.natural_map(x), "us": 1e6 * spent,
                "iterations": iterations, "slides": problem.slides(x),
            }  # fmt: skip


def _timed(call: Call) -> tuple[tuple[np.ndarray, int], float]:
    """Return the answer of a call and its processor time, s; for a short call, the median over blocks of calls."""
    answer, spent = _block(call, 1)
    if spent > _LONG:
        return answer, spent
    many = max(1, int(_BLOCK / max(spent, 1e-6)))
    return answer, statistics.median(_block(call, many)[1] for _ in range(_BLOCKS))


def _block(call: Call, many: int) -> tuple[tuple[np.ndarray, int], float]:
    began = time.thread_time_ns()
    for _ in range(many - 1):
        call()
    answer = call()
    return answer, 1e-9 * (time.thread_time_ns() - began) / many
