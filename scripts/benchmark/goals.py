"""The acceptance lines: each goal the project has set itself, the number measured, and whether it is met."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from .omissions import LATER
from .steps import ALL, FINE, PLAIN

LAW_RATIO, LAW_CONTACTS = 3.0, 16
STEP_RATIO = 4.0
WRAPPER_RATIO, HEAP_RATIO = 1.5, 3.0
SHIPPED_RATIO, EULER_RATIO, SOFT_RATIO = 1.0, 2.5, 1.1
STEPS_PER_SECOND = {"Juggler": 4000, "RockingBlock": 1500, "Billiards": 3000}
CHAIN, CHAIN_FASTER, CHAIN_GROWTH, CHAIN_RESIDUAL = 1000, 5.0, 15.0, 1e-10
IMPORT_SECONDS = 0.3
MANY, OF_SHIPPED, OF_EULER, OF_SOFT, SECOND_THREAD = 1024, 1.0, 0.4, 0.9, 1.8
OF_PROCESSES, COMPILE_SECONDS, LOAD_SECONDS = 5.0, 60.0, 2.0
SOFT_RATIOS = {"Ant-v5": 1.15, "Humanoid-v5": 1.15, "Hopper-v5": 1.25, "Walker2d-v5": 1.25}
SAVED = 0.95  # median time with a part put back, relative to that without, that is no less but for timing
SAME = 1e-12  # m or rad: what two ways to take the same steps may differ by
_COMPARED = {"to_shipped": "shipped", "to_euler": "euler", "soft_to_shipped": "soft steps, shipped"}
_SMALL = ("cradle 5", "cradle 5, Euler", "box_drop", "box_drop, Euler", "box at rest", "box at rest, Euler")


@dataclass(frozen=True)
class Goal:
    """One line: what was asked for, what was measured, whether that is enough."""

    goal: str
    measured: str
    met: bool

    def __str__(self) -> str:
        return f"{'met' if self.met else 'NOT MET':8}{self.goal}: {self.measured}"


def goals(tables: dict[str, pd.DataFrame]) -> list[Goal]:
    """Return the lines that these tables can answer."""
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


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dictionary per row."""
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


def as_table(lines: list[Goal]) -> pd.DataFrame:
    """Return one row per goal."""
    return pd.DataFrame([vars(line) for line in lines])


def _law_goals(table: pd.DataFrame) -> Iterator[Goal]:
    chosen = [row for row in records(table) if row["h"] <= LAW_CONTACTS]
    for kind in _distinct(chosen, "kind"):
        for column, what in (("law_ratio", "solver's certificate"), ("audited_ratio", "independent certificate too")):
            rows = [row for row in chosen if row["kind"] == kind]
            worst = max(rows, key=lambda row: row[column])
            largest = {h: max(row[column] for row in rows if row["h"] == h) for h in _distinct(rows, "h")}
            measured = f"at most {worst[column]:.1f} (h = {worst['h']}, {worst['law']}); "
            measured += ", ".join(f"h = {h}: {ratio:.1f}" for h, ratio in largest.items())
            name = f"law <= {LAW_RATIO:g} x nnls, h <= {LAW_CONTACTS}, {kind} contacts, {what}"
            yield Goal(name, measured, worst[column] <= LAW_RATIO)


def _chain_goals(table: pd.DataFrame) -> Iterator[Goal]:
    solved = [row for row in records(table) if row["outcome"] == "solved"]
    for chain in _distinct(solved, "chain"):
        rows = [row for row in solved if row["chain"] == chain]
        law = {row["h"]: row for row in rows if row["solver"] == "law"}
        others = [row for row in rows if row["solver"] != "law" and row["h"] == CHAIN]
        if CHAIN in law and others:
            others.sort(key=lambda row: row["ratio"])
            shown = [f"{row['solver']} {row['ratio']:.1f} (residual {row['residual']:.0e})" for row in others]
            name = f"{chain} chain of {CHAIN}: law >= {CHAIN_FASTER:g} times faster than OSQP and Clarabel"
            yield Goal(name, ", ".join(shown), others[0]["ratio"] >= CHAIN_FASTER)
        if CHAIN in law and 10 * CHAIN in law:
            ratio = law[10 * CHAIN]["milliseconds"] / law[CHAIN]["milliseconds"]
            name = f"{chain} chain of {10 * CHAIN}: law <= {CHAIN_GROWTH:g} times as long as for {CHAIN}"
            yield Goal(name, f"{ratio:.1f}", ratio <= CHAIN_GROWTH)
        largest = max(row["residual"] for row in law.values())
        name = f"{chain} chains, law: residual < {CHAIN_RESIDUAL:g}"
        yield Goal(name, f"at most {largest:.1e} up to {max(law)} contacts", largest < CHAIN_RESIDUAL)


def _step_goals(table: pd.DataFrame) -> Iterator[Goal]:
    rigid = [row for row in records(table) if row["contact_model"] == "rigid" and row["outcome"] == FINE]
    yield from _soft_goals(table)
    for phase in ("flight", "contact", ALL):
        rows = [row for row in rigid if row["integrator"] == "RK4" and row["phase"] == phase]
        rows.sort(key=lambda row: row["ratio"])
        if rows:
            measured = ", ".join(f"{row['scene']} {row['ratio']:.2f}" for row in rows)
            yield Goal(f"rigid step < mj_step, RK4, {phase} (medians)", measured, rows[-1]["ratio"] < 1.0)
    for scene in _SMALL:
        rows = [row for row in rigid if row["scene"] == scene]
        if rows:
            shown = ", ".join(f"{row['phase']} {row['ratio']:.1f}" for row in rows)
            whole = next(row for row in rows if row["phase"] == ALL)
            worst = max(row["ratio"] for row in rows if row["phase"] != "collision")
            measured = f"{rows[0]['integrator']}, medians {shown}; mean of all {whole['mean_ratio']:.1f}"
            yield Goal(f"rigid step <= {STEP_RATIO:g} x mj_step, {scene}", measured, worst <= STEP_RATIO)


def _wrapper_goals(table: pd.DataFrame) -> Iterator[Goal]:
    for row in records(table):
        name = f"wrapper <= {WRAPPER_RATIO:g} x the plain environment, {row['environment']}"
        yield Goal(name, f"{row['ratio']:.2f}", row["ratio"] <= WRAPPER_RATIO)


def _robot_goals(table: pd.DataFrame) -> Iterator[Goal]:
    for row in records(table):
        most = EULER_RATIO if row["integrator"] == "EULER" else SHIPPED_RATIO
        what = f"mj_step, {row['integrator']}, {row['robot']}"
        measured = row["time_stepping_ratio"]
        yield Goal(f"time stepping <= {most:g} x {what}", f"{measured:.2f}", measured <= most)
        if row["shipped"]:
            soft = row["soft_ratio"]
            yield Goal(f"soft step <= {SOFT_RATIO:g} x {what}", f"{soft:.2f}", soft <= SOFT_RATIO)


def _heap_goals(table: pd.DataFrame) -> Iterator[Goal]:
    for row in records(table):
        name = f"soft step <= {HEAP_RATIO:g} x mj_step, {row['bodies']} bodies in a heap"
        yield Goal(name, f"{row['ratio']:.2f}", row["ratio"] <= HEAP_RATIO)


def _task_goals(table: pd.DataFrame) -> Iterator[Goal]:
    rows = records(table)
    for task in _distinct(rows, "task"):
        found = {row["scheme"]: row["steps_per_second"] for row in rows if row["task"] == task}
        measured = ", ".join(f"{scheme} {speed:.0f}" for scheme, speed in found.items())
        least = STEPS_PER_SECOND[task]
        yield Goal(f"{task} >= {least} environment steps a second", measured, max(found.values()) >= least)


def _soft_goals(table: pd.DataFrame) -> Iterator[Goal]:
    for row in records(table):
        if row["contact_model"] == "soft" and row["phase"] == PLAIN and row["scene"] in SOFT_RATIOS:
            name = f"soft step without a collision <= {SOFT_RATIOS[row['scene']]:g} x mj_step, {row['scene']}"
            yield Goal(name, f"{row['ratio']:.2f}", row["ratio"] <= SOFT_RATIOS[row["scene"]])


def _omission_goals(table: pd.DataFrame) -> Iterator[Goal]:
    for part in LATER:
        some = sorted((row for row in records(table) if row["left_out"] == part), key=lambda row: row["ratio"])
        if some:
            shown = "x, ".join(f"{row['scene']} {row['ratio']:.2f}" for row in some) + "x"
            met = float(np.median([row["ratio"] for row in some])) >= SAVED and all(
                row["difference"] <= SAME for row in some
            )
            name = f"{part} costs nothing where a scene has none: the same motion; put back it takes"
            yield Goal(name, shown, met)


def _import_goal(table: pd.DataFrame) -> Iterator[Goal]:
    added, mujoco = (table[name].to_numpy(dtype=float) for name in ("added_s", "mujoco_s"))
    median = float(np.median(added))
    measured = f"median {median:.3f} s, least {added.min():.3f} s, beside {np.median(mujoco):.3f} s"
    yield Goal(f"import impactlaw adds <= {IMPORT_SECONDS:g} s to import mujoco", measured, median <= IMPORT_SECONDS)


def _distinct(rows: list[dict[str, Any]], column: str) -> list[Any]:
    return list(dict.fromkeys(row[column] for row in rows))


def _worlds_goals(table: pd.DataFrame) -> Iterator[Goal]:
    rows = [row for row in records(table) if row["worlds"] == MANY]
    most = max((row["threads"] for row in rows), default=0)
    for row in rows:
        if row["threads"] == most:
            for column, least in (("to_shipped", OF_SHIPPED), ("to_euler", OF_EULER), ("soft_to_shipped", OF_SOFT)):
                name = f"{MANY} worlds of {row['task']}: >= {least:g} of mujoco.batch, {_COMPARED[column]}"
                if np.isnan(row[column]):
                    continue
                yield Goal(name, f"{row[column]:.2f}", row[column] >= least)
    for row in rows:
        alone = [one for one in rows if one["task"] == row["task"] and one["threads"] == 1]
        if row["threads"] == 2 and alone:
            ratio = row["steps_per_s"] / alone[0]["steps_per_s"]
            yield Goal(f"two threads >= {SECOND_THREAD:g} x one, {row['task']}", f"{ratio:.2f}", ratio >= SECOND_THREAD)


def _vector_goal(table: pd.DataFrame) -> Iterator[Goal]:
    ours, processes = table["steps_per_s"].to_numpy(dtype=float)
    name = f"worlds of Hopper >= {OF_PROCESSES:g} x AsyncVectorEnv of the wrapper"
    yield Goal(name, f"{ours / processes:.1f}", bool(ours >= OF_PROCESSES * processes))


def _compiling_goals(table: pd.DataFrame) -> Iterator[Goal]:
    rows = records(table)
    for process, most in (("compiles", COMPILE_SECONDS), ("loads", LOAD_SECONDS)):
        seconds = float(np.median([row["processor_s"] for row in rows if row["process"] == process]))
        yield Goal(f"a process that {process}: <= {most:g} s", f"{seconds:.1f} s", seconds <= most)
