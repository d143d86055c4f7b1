"""Run time of rigid steps against `mj_step`, on the same scene, integrator and start, in one process.

Rigid stepping and `mj_step` each follow their own motion from the same start, in alternating blocks of steps, because
their states differ (soft contacts rest in penetration). Steps are sorted by phase: "collision" (the law was applied),
"contact" (bodies touch) and "flight" (no contact).
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw import ImpactLawError, Stepper, read_contacts

from .scenes import Scene, builders
from .timing import MICRO, Row, no_collection

ALL, FINE = "all", "fine"
PHASES = ("flight", "contact", "collision")
FEWEST = 20
"""Smallest number of steps of a scene, however long they take."""
_BLOCK = 10


class Costs:
    """Times of the steps of one kind by phase, in microseconds, and the accuracy of their collisions.

    Attributes:
        residual: largest `Impact.residual`.
        penetration: largest penetration of rigid contacts at the end of a step, m.
        outcome: "fine", or why the stepping stopped.
    """

    def __init__(self):
        self._by_phase: dict[str, list[float]] = {phase: [] for phase in PHASES}
        self.residual, self.penetration, self.steps, self.outcome = 0.0, 0.0, 0, FINE

    def book(self, phase: str, seconds: float) -> None:
        """Record the time of one step."""
        self._by_phase[phase].append(MICRO * seconds)
        self.steps += 1

    def of(self, phase: str) -> np.ndarray:
        """Return the times of the steps of a phase or of all steps, in microseconds."""
        return np.concatenate([self._by_phase[name] for name in (PHASES if phase == ALL else (phase,))])


class Turn(NamedTuple):
    """One way to step: its state, its step function, what `note` reads after a step, and `book`, which records it."""

    data: mujoco.MjData
    step: Callable[[mujoco.MjData], object]
    note: Callable[[], Any]
    book: Callable[[float, Any], None]


def run(
    cradles: tuple[int, ...] = (5, 100, 1000),
    environments: tuple[str, ...] = ("Ant-v5", "Humanoid-v5", "Hopper-v5", "Walker2d-v5"),
    *,
    full: bool = True,
    seconds: float = 2.0,
) -> Iterator[Row]:
    """Yield one row per scene and phase.

    Columns: steps (in that phase), median_us, mean_us; mj_steps, mj_median_us, mj_mean_us of `mj_step` in the same
    phase, or over all of its steps where it is never in that phase; ratio of the medians and mean_ratio; the largest
    residual and penetration (m) of the motion; outcome, "fine" or why the stepping stopped. The phase "all" contains
    the whole motion.

    Args:
        cradles: numbers of balls of the cradles.
        environments: ids of gymnasium's MuJoCo environments; rigid stepping ignores their friction.
        full: whether to include every scene of models/.
        seconds: time per scene.
    """
    for build in builders(cradles, environments, full=full).values():
        scene = build()
        yield from _rows(scene, *_step(scene, seconds))


def _step(scene: Scene, seconds: float) -> tuple[Costs, Costs]:
    """Step rigidly and by `mj_step`, each along its own motion from the same start."""
    model = scene.model
    stepper = Stepper(model, scene.law, friction=scene.friction)
    rigid, bare, seen = mujoco.MjData(model), mujoco.MjData(model), mujoco.MjData(model)
    costs, bare_costs = Costs(), Costs()

    def note() -> tuple[np.ndarray, bool]:
        costs.residual = max([costs.residual, *(event.impact.residual for event in stepper.events)])
        return rigid.qpos.copy(), bool(stepper.events)

    def book(seconds: float, noted: tuple[np.ndarray, bool]) -> None:
        seen.qpos[:], collided = noted
        gap = read_contacts(model, seen).gap
        costs.book("collision" if collided else "contact" if len(gap) else "flight", seconds)
        costs.penetration = max(costs.penetration, -float(gap.min(initial=0.0)))

    def book_bare(seconds: float, contacts: int) -> None:
        bare_costs.book("contact" if contacts else "flight", seconds)

    turns: list[Turn] = [
        Turn(rigid, stepper.step, note, book),
        Turn(bare, partial(mujoco.mj_step, model), lambda: bare.ncon, book_bare),
    ]
    end = time.perf_counter() + seconds
    try:
        for start in cycle(scene.starts):
            for turn in turns:
                scene.begin(turn.data, start, turn.step)
            for first in range(0, scene.episode, _BLOCK):
                turns.reverse()
                for turn in turns:
                    _take(scene, turn, range(first, first + _BLOCK))
                if costs.steps >= FEWEST and time.perf_counter() > end:
                    return costs, bare_costs
    except ImpactLawError as error:
        costs.outcome = f"{type(error).__name__}: {error}"
    return costs, bare_costs


def _take(scene: Scene, turn: Turn, numbers: range) -> None:
    """Take steps, and book them afterwards, so that reading the contacts does not disturb the processor's caches."""
    taken = []
    for number in numbers:
        scene.drive(turn.data, number)
        with no_collection():
            start = time.perf_counter()
            turn.step(turn.data)
            seconds = time.perf_counter() - start
        taken.append((seconds, turn.note()))
    for seconds, noted in taken:
        turn.book(seconds, noted)


def _rows(scene: Scene, costs: Costs, bare: Costs) -> Iterator[Row]:
    about = {"scene": scene.name, "integrator": scene.integrator, "nv": scene.model.nv}
    right = {"residual": costs.residual, "penetration": costs.penetration, "outcome": costs.outcome}
    for phase in (*PHASES, ALL):
        ours = costs.of(phase)
        if len(ours) == 0 and phase != ALL:
            continue
        theirs = bare.of("contact" if phase == "collision" else phase)
        theirs = theirs if len(theirs) else bare.of(ALL)
        row: Row = {"phase": phase, "steps": len(ours), "mj_steps": len(theirs)}
        for name, statistic in (("median", np.median), ("mean", np.mean)):
            one, other = (float(statistic(times)) if len(times) else np.nan for times in (ours, theirs))
            ratio = "ratio" if name == "median" else "mean_ratio"
            row |= {f"{name}_us": one, f"mj_{name}_us": other, ratio: one / other}
        yield about | row | right
