"""Time laws, steps and the import, next to bare `scipy.optimize.nnls`, `mj_step` and ``import mujoco``.

Both sides of a comparison are measured in this run on this machine, taking turns in one process where that is possible.
Tables are printed and written as CSV, with one line for each performance goal of the project. Timings vary from run to
run; ratios vary less.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import pandas as pd
from tqdm import tqdm

from scripts import machine, options

from . import chains, environments, laws, omissions, processes, steps, worlds
from .goals import as_table, goals

Part = Literal[
    "laws", "chains", "steps", "wrappers", "robots", "heaps", "tasks", "omissions", "imports", "worlds", "vector",
    "compiling",
]  # fmt: skip
_RUN: dict[Part, Callable[..., Iterable[object]]] = {
    "laws": laws.run,
    "chains": chains.run,
    "steps": steps.run,
    "wrappers": environments.run_wrappers,
    "robots": environments.run_robots,
    "heaps": environments.run_heaps,
    "tasks": environments.run_tasks,
    "omissions": omissions.run,
    "imports": processes.run_imports,
    "worlds": worlds.run,
    "vector": worlds.run_vector,
    "compiling": processes.run_compiling,
}
_HOPPER = ("Hopper-v5",)
QUICK: dict[Part, dict[str, Any]] = {
    "laws": {"sizes": (1, 4, 16), "problems": 2, "seconds": 0.01},
    "chains": {"sizes": (100, 1000), "seconds": 0.1},
    "steps": {"cradles": (5, 20), "environments": _HOPPER, "full": False, "seconds": 0.2},
    "wrappers": {"wrapped": _HOPPER, "steps": 50, "repetitions": 2},
    "robots": {"robots": _HOPPER, "steps": 100, "repetitions": 1},
    "heaps": {"bodies": (10,), "steps": 100, "repetitions": 1},
    "tasks": {"tasks": ("Juggler",), "actions": 50, "repetitions": 1},
    "omissions": {"scenes": ("pendulum", "cradle 5"), "steps": 20, "seconds": 0.1},
    "imports": {"processes": 1},
    "worlds": {"tasks": _HOPPER, "counts": (1, 64), "threads": (1, 2), "calls": 3},
    "vector": {"worlds": 16, "steps": 200},
}
"""Arguments of the quick form of each part: fewer and smaller cases. It leaves out "compiling"."""


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """What to measure."""

    parts: tuple[Part, ...] = get_args(Part)
    """Which parts to run."""
    quick: bool = False
    """Run fewer and smaller cases without compiling, in less than a minute; their times say little about large ones."""
    out: Path = Path("out/benchmark")
    """Folder of the CSV files."""


def run(parts: Iterable[Part], *, quick: bool = False) -> dict[str, pd.DataFrame]:
    """Return one table per part, and the table of goals."""
    tables = {}
    for part in parts:
        if quick and part not in QUICK:
            continue
        rows = _RUN[part](**QUICK[part] if quick else {})
        tables[part] = pd.DataFrame(tqdm(rows, desc=part, unit=" rows", disable=None))
    return tables | {"goals": as_table(goals(tables))}


def show(tables: dict[str, pd.DataFrame]) -> str:
    """Return all tables as text, then one line per goal, then the machine."""
    shown = []
    for name, table in tables.items():
        if name != "goals":
            shown.append(f"{name}\n{table.to_string(index=False, float_format=lambda x: f'{x:.3g}', na_rep='-')}")
    shown.append("\n".join(map(str, goals(tables))))
    return "\n\n".join([*shown, machine.one_line()])


def main(study: Benchmark) -> None:
    """Measure, print and write."""
    tables = run(study.parts, quick=study.quick)
    print(show(tables))
    machine.write(tables, study.out)


if __name__ == "__main__":
    main(options.read(Benchmark, __doc__))
