"""What laws, steps and the import cost, next to bare `scipy.optimize.nnls`, `mj_step` and ``import mujoco``.

Everything is measured on this machine in this run: one process for what is compared, in turns. Tables are printed and
written as CSV, with a line for each goal that the project has set itself. Timings vary from run to run; the ratios vary
less.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, get_args

import benchmark_chains
import benchmark_floor
import benchmark_impacts
import benchmark_import
import benchmark_laws
import benchmark_memory
import benchmark_plan
import benchmark_profile
import benchmark_steps
import benchmark_walkers
import machine
import pandas as pd
import tyro
from benchmark_goals import as_table, goals
from benchmark_growth import growth
from tqdm import tqdm

Part = Literal["laws", "chains", "impacts", "steps", "walkers", "omissions", "memory", "import", "profile", "floor"]
_THREADS = "OPENBLAS_NUM_THREADS"
_QUICK_ENVIRONMENTS = ("Hopper-v5",)


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """What to measure; a field per part."""

    parts: tuple[Part, ...] = get_args(Part)
    """Which parts to run."""
    laws: benchmark_laws.LawCost = field(default_factory=benchmark_laws.LawCost)
    chains: benchmark_chains.ChainCost = field(default_factory=benchmark_chains.ChainCost)
    impacts: benchmark_impacts.ImpactCost = field(default_factory=benchmark_impacts.ImpactCost)
    steps: benchmark_steps.StepCost = field(default_factory=benchmark_steps.StepCost)
    walkers: benchmark_walkers.Walkers = field(default_factory=benchmark_walkers.Walkers)
    omissions: benchmark_plan.Omissions = field(default_factory=benchmark_plan.Omissions)
    memory: benchmark_memory.Memory = field(default_factory=benchmark_memory.Memory)
    imports: benchmark_import.ImportTime = field(default_factory=benchmark_import.ImportTime)
    profile: benchmark_profile.Profile = field(default_factory=benchmark_profile.Profile)
    floor: benchmark_floor.Floor = field(default_factory=benchmark_floor.Floor)

    def quickly(self) -> Benchmark:
        """Return the same with fewer and smaller cases: for a look, and for the tests."""
        return replace(
            self,
            laws=benchmark_laws.LawCost(sizes=(1, 4, 16), problems=2, seconds=0.01),
            chains=benchmark_chains.ChainCost(sizes=(100, 1000), seconds=0.1),
            impacts=benchmark_impacts.ImpactCost(
                cradles=(5,), environments=_QUICK_ENVIRONMENTS, full=False, seconds=0.1
            ),
            steps=benchmark_steps.StepCost(cradles=(5, 20), environments=_QUICK_ENVIRONMENTS, full=False, seconds=0.2),
            walkers=benchmark_walkers.Walkers(environments=("Ant-v5",), steps=30),
            omissions=benchmark_plan.Omissions(scenes=("pendulum", "cradle 5"), steps=20, seconds=0.1),
            memory=benchmark_memory.Memory(contacts=(16,), cradles=(5,)),
            imports=benchmark_import.ImportTime(processes=1),
            profile=benchmark_profile.Profile(steps=100),
            floor=benchmark_floor.Floor(scenes=("box_drop", *_QUICK_ENVIRONMENTS), steps=100, seconds=0.05),
        )


def parts(study: Benchmark) -> dict[Part, tuple[int, Callable[[Callable[[], object]], pd.DataFrame]]]:
    """Return, for each part to run, in how many pieces it reports progress, and what returns its table."""
    known: dict[Part, tuple[int, Callable[[Callable[[], object]], pd.DataFrame]]] = {
        "laws": (len(benchmark_laws.rows(study.laws)), partial(benchmark_laws.run, study.laws)),
        "chains": (len(benchmark_chains.cases(study.chains)), partial(benchmark_chains.run, study.chains)),
        "impacts": (len(benchmark_impacts.names(study.impacts)), partial(benchmark_impacts.run, study.impacts)),
        "steps": (len(benchmark_steps.names(study.steps)), partial(benchmark_steps.run, study.steps)),
        "walkers": (len(study.walkers.environments), partial(benchmark_walkers.run, study.walkers)),
        "omissions": (len(benchmark_plan.names(study.omissions)), partial(benchmark_plan.run, study.omissions)),
        "memory": (len(benchmark_memory.cases(study.memory)), partial(benchmark_memory.run, study.memory)),
        "import": (study.imports.processes, partial(benchmark_import.run, study.imports)),
        "profile": (len(study.profile.scenes), partial(benchmark_profile.run, study.profile)),
        "floor": (len(study.floor.scenes), partial(benchmark_floor.run, study.floor)),
    }
    return {name: part for name, part in known.items() if name in study.parts}


def run(study: Benchmark, progress: Callable[[], object] = lambda: None) -> dict[str, pd.DataFrame]:
    """Return one table per part, how what they hold grows, and the table of goals."""
    tables: dict[str, pd.DataFrame] = {name: part(progress) for name, (_, part) in parts(study).items()}
    tables["growth"] = growth(tables)
    tables["goals"] = as_table(goals(tables))
    return tables


def show(tables: dict[str, pd.DataFrame]) -> str:
    """Return all tables as text, then one line per goal, then the machine."""
    shown = []
    for name, table in tables.items():
        if name != "goals":
            shown.append(f"{name}\n{table.to_string(index=False, float_format=lambda x: f'{x:.3g}', na_rep='-')}")
    shown.append("\n".join(map(str, goals(tables))))
    return "\n\n".join([*shown, described()])


def write(tables: dict[str, pd.DataFrame], folder: Path) -> None:
    """Write each table as CSV, and the machine's description."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "machine.txt").write_text(described() + "\n")


def described() -> str:
    """Return the machine, the versions and the number of BLAS threads in one line."""
    return f"{machine.one_line()}; BLAS threads: {os.environ.get(_THREADS, 'as the library chooses')}"


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line asks for."""

    study: Annotated[Benchmark, tyro.conf.arg(name="")] = field(default_factory=Benchmark)
    quick: bool = False
    """Fewer and smaller cases, in less than a minute; what these cost says little about large ones."""
    out: Path = Path("out/benchmark")
    """Folder of the CSV files."""


def main() -> None:
    """Measure, print and write, with one BLAS thread: on a busy machine two cost up to a hundred times as much."""
    if _THREADS not in os.environ:  # numpy reads it when it is imported
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, _THREADS: "1"})
    options = tyro.cli(Options, description=__doc__)
    study = options.study.quickly() if options.quick else options.study
    with tqdm(total=sum(count for count, _ in parts(study).values()), disable=None) as bar:
        tables = run(study, bar.update)
    print(show(tables))
    write(tables, options.out)


if __name__ == "__main__":
    main()
