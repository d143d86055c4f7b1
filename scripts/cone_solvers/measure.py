"""Solve every problem by every solver, from the guess and from zero impulses."""

import statistics
import time
import timeit
from collections.abc import Iterator

import numpy as np

from .problem import Problem
from .solvers import Call, Solver

STARTS = ("guess", "rest")
Row = dict[str, object]
_LONG = 0.02  # s; a longer call is timed once
_BLOCKS, _BLOCK = 3, 5e-4  # number of blocks of calls whose median counts, and the duration of each, s


def warm_up(solvers: list[Solver], problems: list[Problem]) -> None:
    """Let every solver solve the first problem, so that loading and compiling are not timed."""
    for solver in solvers:
        for problem in problems[:1]:
            solver.bind(problem, problem.guess)()


def rows_of(number: int, problem: Problem, solvers: list[Solver], most_rows: int) -> Iterator[Row]:
    """Yield one row per solver and start.

    Columns: problem, its number; scene, rows, singular; solver, start; missed, the natural map; us, processor time in
    microseconds; iterations; slides, whether a contact that carries an impulse slides.
    """
    about = {"problem": number, "scene": problem.scene, "rows": len(problem.offset), "singular": problem.is_singular()}
    for solver in solvers:
        if not solver.any_size and len(problem.offset) > most_rows:
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
    began = time.thread_time()
    answer = call()
    spent = time.thread_time() - began
    if spent <= _LONG:
        many = max(1, int(_BLOCK / max(spent, 1e-6)))
        spent = statistics.median(timeit.repeat(call, timer=time.thread_time, repeat=_BLOCKS, number=many)) / many
    return answer, spent
