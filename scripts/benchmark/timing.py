"""Timing of several calls against each other in one process, in turns, so that a slow machine slows them alike."""

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

MICRO = 1e6
Row = dict[str, object]
"""A row of a table, by names of columns."""


@dataclass(frozen=True)
class Timed:
    """Times of several subjects, one value per round.

    Attributes:
        seconds: time per call of each subject, s, name -> (rounds,).
    """

    seconds: dict[str, np.ndarray]

    def microseconds(self, name: str) -> float:
        """Return the time per call, the median over the rounds, in microseconds."""
        return MICRO * float(np.median(self.seconds[name]))

    def ratio(self, name: str, to: str) -> float:
        """Return the ratio of the times of two subjects, the median over the rounds."""
        return float(np.median(self.seconds[name] / self.seconds[to]))


def in_turns(
    subjects: Mapping[str, Callable[[], Sequence[Callable[[], object]]]],
    *,
    seconds: float,
    fewest: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> Timed:
    """Time the subjects in turns, in alternating order, until the time is up.

    Args:
        subjects: name -> a function that prepares one round, untimed, and returns the calls of the round.
        seconds: wall-clock time to spend, preparation included.
        fewest: smallest number of rounds, however long they take; one round before them is not counted.
        clock: clock to read before and after a round; processor time is disturbed less by other processes.
    """
    names = list(subjects)
    taken: dict[str, list[float]] = {name: [] for name in names}
    start = time.perf_counter()
    done = -1
    while done < fewest or time.perf_counter() - start < seconds:
        for name in names if done % 2 else names[::-1]:
            calls = subjects[name]()
            with no_collection():
                before = clock()
                for call in calls:
                    call()
                spent = clock() - before
            if done >= 0:
                taken[name].append(spent / len(calls))
        done += 1
    return Timed({name: np.array(values) for name, values in taken.items()})


def fastest(runs: Mapping[str, Callable[[], np.ndarray]], repetitions: int) -> dict[str, float]:
    """Repeat runs in turns, in alternating order, and return the time of each, s.

    A run returns the time of each of its pieces. The fastest time of each piece counts, so that other processes on the
    machine disturb the result less.
    """
    pieces: dict[str, list[np.ndarray]] = {name: [] for name in runs}
    for repetition in range(repetitions):
        for name in list(runs)[:: 1 if repetition % 2 else -1]:
            pieces[name].append(runs[name]())
    return {name: float(np.min(several, axis=0).sum()) for name, several in pieces.items()}


@contextmanager
def no_collection() -> Iterator[None]:
    """Disable Python's garbage collector while something is timed, as timeit does."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
