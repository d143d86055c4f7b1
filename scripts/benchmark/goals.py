"""The performance goals of the project: for each, the number measured, and whether the goal is met."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from .omissions import LATER
from .steps import ALL, FINE

LAW_RATIO, LAW_CONTACTS = 3.0, 16
STEP_RATIO = 4.0
WRAPPER_RATIO, HEAP_RATIO = 1.5, 3.0
SHIPPED_RATIO, EULER_RATIO, SOFT_RATIO = 1.0, 2.5, 1.1
STEPS_PER_SECOND = {"Juggler": 4000, "RockingBlock": 1500, "Billiards": 3000}
CHAIN, CHAIN_FASTER, CHAIN_GROWTH, CHAIN_RESIDUAL = 1000, 5.0, 15.0, 1e-10
IMPORT_SECONDS = 0.3
MANY, SECOND_THREAD = 1024, 1.8
OF_PROCESSES, COMPILE_SECONDS, LOAD_SECONDS = 5.0, 60.0, 2.0
SAVED = 0.95  # smallest allowed time with a part put back, relative to that without it (median of scenes), given noise
SAME = 1e-12  # m or rad; largest difference between two ways to take the same steps
_COMPARED = {
    "to_shipped": ("shipped", 1.0),
    "to_euler": ("euler", 0.4),
    "soft_to_shipped": ("soft steps, shipped", 0.9),
}
_SMALL = ("cradle 5", "box_drop", "box at rest")


@dataclass(frozen=True)
class Goal:
    """One line: the goal, the measured value, and whether the goal is met."""

    goal: str
    measured: str
    met: bool

    def __str__(self) -> str:
        return f"{'met' if self.met else 'NOT MET':8}{self.goal}: {self.measured}"


def goals(tables: dict[str, pd.DataFrame]) -> list[Goal]:
    """Return the goals that these tables can judge."""
    answers = {
        "laws": _law_goals,
        "chains": _chain_goals,
        "steps": _step_goals,
        "wrappers": _wrapper_goals,
        "robots": _robot_goals,
        "heaps": _heap_goals,
        "tasks": _task_goals,
        "omissions": _omission_goals,
        "imports": _import_goal,
        "worlds": _worlds_goals,
        "vector": _vector_goal,
        "compiling": _compiling_goals,
    }
    return [goal for name, answer in answers.items() if name in tables for goal in answer(tables[name])]


def records(table: Any) -> list[dict[str, Any]]:  # the types of pandas do not tell rows from columns
    """Return one dictionary per row."""
    return table.to_dict("records")


def as_table(lines: list[Goal]) -> pd.DataFrame:
    """Return one row per goal."""
    return pd.DataFrame([vars(line) for line in lines])


def _most(goal: str, value: float, most: float, digits: int = 2, unit: str = "") -> Goal:
    """Return the goal of a value with an upper bound."""
    return Goal(goal, f"{value:.{digits}f}{unit}", bool(value <= most))


def _least(goal: str, value: float, least: float, digits: int = 2) -> Goal:
    """Return the goal of a value with a lower bound."""
    return Goal(goal, f"{value:.{digits}f}", bool(value >= least))


def _law_goals(table: Any) -> Iterator[Goal]:
    chosen = table[table.h <= LAW_CONTACTS]
    for kind, rows in chosen.groupby("kind", sort=False):
        for column, what in (("law_ratio", "solver's certificate"), ("audited_ratio", "independent certificate too")):
            worst = rows.loc[rows[column].idxmax()]
            measured = f"at most {worst[column]:.1f} (h = {worst.h}, {worst.law}); "
            measured += ", ".join(f"h = {h}: {ratio:.1f}" for h, ratio in rows.groupby("h")[column].max().items())
            name = f"law <= {LAW_RATIO:g} x nnls, h <= {LAW_CONTACTS}, {kind} contacts, {what}"
            yield Goal(name, measured, bool(worst[column] <= LAW_RATIO))


def _chain_goals(table: Any) -> Iterator[Goal]:
    for chain, rows in table[table.outcome == "solved"].groupby("chain", sort=False):
        law = rows[rows.solver == "law"].set_index("h")
        others = rows[(rows.solver != "law") & (rows.h == CHAIN)].sort_values("ratio")
        if CHAIN in law.index and len(others):
            shown = [f"{row['solver']} {row['ratio']:.1f} (residual {row['residual']:.0e})" for row in records(others)]
            name = f"{chain} chain of {CHAIN}: law >= {CHAIN_FASTER:g} times faster than OSQP and Clarabel"
            yield Goal(name, ", ".join(shown), bool(others.ratio.min() >= CHAIN_FASTER))
        if CHAIN in law.index and 10 * CHAIN in law.index:
            ratio = float(law.milliseconds[10 * CHAIN] / law.milliseconds[CHAIN])
            name = f"{chain} chain of {10 * CHAIN}: law <= {CHAIN_GROWTH:g} times as long as for {CHAIN}"
            yield _most(name, ratio, CHAIN_GROWTH, 1)
        largest = float(law.residual.max())
        measured = f"at most {largest:.1e} up to {law.index.max()} contacts"
        yield Goal(f"{chain} chains, law: residual < {CHAIN_RESIDUAL:g}", measured, largest < CHAIN_RESIDUAL)


def _step_goals(table: Any) -> Iterator[Goal]:
    rigid = table[table.outcome == FINE]
    for phase in ("flight", "contact", ALL):
        rows = rigid[(rigid.integrator == "RK4") & (rigid.phase == phase)].sort_values("ratio")
        if len(rows):
            shown = ", ".join(f"{row['scene']} {row['ratio']:.2f}" for row in records(rows))
            yield Goal(f"rigid step < mj_step, RK4, {phase} (medians)", shown, bool(rows.ratio.max() < 1.0))
    for scene in _SMALL:
        rows = rigid[rigid.scene == scene]
        if len(rows):
            shown = ", ".join(f"{row['phase']} {row['ratio']:.1f}" for row in records(rows))
            mean = rows.mean_ratio[rows.phase == ALL].item()
            measured = f"{rows.integrator.iloc[0]}, medians {shown}; mean of all {mean:.1f}"
            met = bool(rows.ratio[rows.phase != "collision"].max() <= STEP_RATIO)
            yield Goal(f"rigid step <= {STEP_RATIO:g} x mj_step, {scene}", measured, met)


def _wrapper_goals(table: Any) -> Iterator[Goal]:
    for row in records(table):
        name = f"wrapper <= {WRAPPER_RATIO:g} x the plain environment, {row['environment']}"
        yield _most(name, row["ratio"], WRAPPER_RATIO)


def _robot_goals(table: Any) -> Iterator[Goal]:
    for row in records(table):
        most = EULER_RATIO if row["integrator"] == "EULER" else SHIPPED_RATIO
        what = f"mj_step, {row['integrator']}, {row['robot']}"
        yield _most(f"time stepping <= {most:g} x {what}", row["time_stepping_ratio"], most)
        if row["shipped"]:
            yield _most(f"soft step <= {SOFT_RATIO:g} x {what}", row["soft_ratio"], SOFT_RATIO)


def _heap_goals(table: Any) -> Iterator[Goal]:
    for row in records(table):
        name = f"soft step <= {HEAP_RATIO:g} x mj_step, {row['bodies']} bodies in a heap"
        yield _most(name, row["ratio"], HEAP_RATIO)


def _task_goals(table: Any) -> Iterator[Goal]:
    for task, rows in table.groupby("task", sort=False):
        measured = ", ".join(f"{row['scheme']} {row['steps_per_second']:.0f}" for row in records(rows))
        least = STEPS_PER_SECOND[str(task)]
        alone = rows[~rows.scheme.str.endswith("worlds")]
        met = bool(alone.steps_per_second.max() >= least)
        yield Goal(f"{task} >= {least} environment steps a second", measured, met)


def _omission_goals(table: Any) -> Iterator[Goal]:
    for part in LATER:
        some = table[table.left_out == part].sort_values("ratio")
        if len(some):
            shown = "x, ".join(f"{row['scene']} {row['ratio']:.2f}" for row in records(some)) + "x"
            met = bool(some.ratio.median() >= SAVED and (some.difference <= SAME).all())
            yield Goal(f"{part} costs nothing where a scene has none: the same motion; put back it takes", shown, met)


def _import_goal(table: Any) -> Iterator[Goal]:
    added = table.added_s
    measured = f"median {added.median():.3f} s, least {added.min():.3f} s, beside {table.mujoco_s.median():.3f} s"
    met = bool(added.median() <= IMPORT_SECONDS)
    yield Goal(f"import impactlaw adds <= {IMPORT_SECONDS:g} s to import mujoco", measured, met)


def _worlds_goals(table: Any) -> Iterator[Goal]:
    rows = table[table.worlds == MANY]
    for row in records(rows[rows.threads == rows.threads.max()]):
        for column, (what, least) in _COMPARED.items():
            if not np.isnan(row[column]):
                name = f"{MANY} worlds of {row['task']}: >= {least:g} of mujoco.batch, {what}"
                yield _least(name, row[column], least)
    alone = rows[rows.threads == 1].set_index("task").steps_per_s
    for row in records(rows[(rows.threads == 2) & rows.task.isin(alone.index)]):
        ratio = row["steps_per_s"] / alone[row["task"]]
        yield _least(f"two threads >= {SECOND_THREAD:g} x one, {row['task']}", ratio, SECOND_THREAD)


def _vector_goal(table: Any) -> Iterator[Goal]:
    ours, processes = table.steps_per_s
    name = f"worlds of Hopper >= {OF_PROCESSES:g} x AsyncVectorEnv of the wrapper"
    yield _least(name, ours / processes, OF_PROCESSES, 1)


def _compiling_goals(table: Any) -> Iterator[Goal]:
    for process, most in (("compiles", COMPILE_SECONDS), ("loads", LOAD_SECONDS)):
        seconds = table.processor_s[table.process == process].median()
        yield _most(f"a process that {process}: <= {most:g} s", seconds, most, 1, " s")
