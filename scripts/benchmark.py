"""What laws, steps and the import cost, next to bare `scipy.optimize.nnls`, `mj_step` and ``import mujoco``.

Everything is measured on this machine in this run: one process for what is compared, in turns. Tables are printed and
written as CSV, with a line for each goal that the project has set itself. Timings vary from run to run; the ratios vary
less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import benchmark_impacts
import benchmark_import
import benchmark_laws
import benchmark_memory
import benchmark_profile
import benchmark_steps
import machine
import pandas as pd
import tyro
from benchmark_goals import as_table, goals
from tqdm import tqdm

Part = Literal["laws", "impacts", "steps", "memory", "import", "profile"]
_QUICK_ENVIRONMENTS = ("Hopper-v5",)


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """What to measure; a field per part."""

    parts: tuple[Part, ...] = ("laws", "impacts", "steps", "memory", "import", "profile")
    """Which parts to run."""
    laws: benchmark_laws.LawCost = field(default_factory=benchmark_laws.LawCost)
    impacts: benchmark_impacts.ImpactCost = field(default_factory=benchmark_impacts.ImpactCost)
    steps: benchmark_steps.StepCost = field(default_factory=benchmark_steps.StepCost)
    memory: benchmark_memory.Memory = field(default_factory=benchmark_memory.Memory)
    imports: benchmark_import.ImportTime = field(default_factory=benchmark_import.ImportTime)
    profile: benchmark_profile.Profile = field(default_factory=benchmark_profile.Profile)

    def quickly(self) -> Benchmark:
        """Return the same with fewer and smaller cases: for a look, and for the tests."""
        return replace(
            self,
            laws=benchmark_laws.LawCost(sizes=(1, 4, 16), problems=2, seconds=0.01),
            impacts=benchmark_impacts.ImpactCost(
                cradles=(5,), environments=_QUICK_ENVIRONMENTS, full=False, seconds=0.1
            ),
            steps=benchmark_steps.StepCost(cradles=(5, 20), environments=_QUICK_ENVIRONMENTS, full=False, seconds=0.2),
            memory=benchmark_memory.Memory(contacts=(16,), cradles=(5,)),
            imports=benchmark_import.ImportTime(processes=1),
            profile=benchmark_profile.Profile(steps=100),
        )


def parts(study: Benchmark) -> dict[Part, tuple[int, Callable[[Callable[[], object]], pd.DataFrame]]]:
    """Return, for each part to run, in how many pieces it reports progress, and what returns its table."""
    known: dict[Part, tuple[int, Callable[[Callable[[], object]], pd.DataFrame]]] = {
        "laws": (len(benchmark_laws.rows(study.laws)), lambda tick: benchmark_laws.run(study.laws, tick)),
        "impacts": (
            len(benchmark_impacts.names(study.impacts)),
            lambda tick: benchmark_impacts.run(study.impacts, tick),
        ),
        "steps": (len(benchmark_steps.names(study.steps)), lambda tick: benchmark_steps.run(study.steps, tick)),
        "memory": (len(benchmark_memory.cases(study.memory)), lambda tick: benchmark_memory.run(study.memory, tick)),
        "import": (study.imports.processes, lambda tick: benchmark_import.run(study.imports, tick)),
        "profile": (len(study.profile.scenes), lambda tick: benchmark_profile.run(study.profile, tick)),
    }
    return {name: part for name, part in known.items() if name in study.parts}


def run(study: Benchmark, progress: Callable[[], object] = lambda: None) -> dict[str, pd.DataFrame]:
    """Return one table per part, and the table of goals."""
    tables: dict[str, pd.DataFrame] = {name: part(progress) for name, (_, part) in parts(study).items()}
    tables["goals"] = as_table(goals(tables))
    return tables


def show(tables: dict[str, pd.DataFrame]) -> str:
    """Return all tables as text, then one line per goal, then the machine."""
    shown = []
    for name, table in tables.items():
        if name != "goals":
            shown.append(f"{name}\n{table.to_string(index=False, float_format=lambda x: f'{x:.3g}', na_rep='-')}")
    shown.append("\n".join(map(str, goals(tables))))
    return "\n\n".join([*shown, machine.one_line()])


def write(tables: dict[str, pd.DataFrame], folder: Path) -> None:
    """Write each table as CSV, and the machine's description."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "machine.txt").write_text(machine.one_line() + "\n")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line asks for."""

    study: Annotated[Benchmark, tyro.conf.arg(name="")] = field(default_factory=Benchmark)
    quick: bool = False
    """Fewer and smaller cases, in less than a minute; what these cost says little about large ones."""
    out: Path = Path("out/benchmark")
    """Folder of the CSV files."""


def main() -> None:
    """Measure, print and write."""
    options = tyro.cli(Options, description=__doc__)
    study = options.study.quickly() if options.quick else options.study
    with tqdm(total=sum(count for count, _ in parts(study).values()), disable=None) as bar:
        tables = run(study, bar.update)
    print(show(tables))
    write(tables, options.out)


if __name__ == "__main__":
    main()
