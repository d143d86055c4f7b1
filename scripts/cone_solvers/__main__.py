"""Solve contact problems with friction, captured from time stepping of 15 scenes, by our solver and by others.

Each problem is solved from the initial guess of the scheme, and from zero. A solver is judged by processor time and by
the largest natural map of a contact, relative to the largest offset of a contact. The other solvers are nonsmooth
Gauss-Seidel and, where it is installed, Clarabel (convex programs, in a fixed-point iteration).
Two tables are printed, by solver and, for our solver, by scene; they are also written to files, together with all rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from tqdm import tqdm

from scripts import machine, options
from scripts.robots.scenes import Scene, chosen

from .catalogue import QUICK, catalogue

if TYPE_CHECKING:  # their imports load and compile code; `--help` should not wait for that
    from .problem import Problem
    from .solvers import Solver


@dataclass(frozen=True, kw_only=True)
class Study:
    """Which problems to solve, and up to which size."""

    problems: options.Count = 1080
    """Total number of problems, the same number from each scene."""
    only: tuple[str, ...] = ()
    """Names of scenes, or parts of names; all scenes if not given."""
    most_rows: options.Count = 300
    """Largest number of rows of the problems that Clarabel gets."""
    quick: bool = False
    """Solve 100 problems of 5 scenes only, in less than a minute."""
    out: Path = Path("out/cone_solvers")
    """Folder of the files."""


def captured(study: Study, scenes: list[Scene]) -> list[Problem]:
    """Return problems captured from all scenes."""
    from . import capture

    share = -(-study.problems // max(1, len(scenes)))
    found = []
    for scene in tqdm(scenes, desc="capturing", unit="scene", disable=None):
        found += capture.problems_of(scene, share)
    return found


def run(study: Study, problems: Iterable[Problem], who: list[Solver]) -> pd.DataFrame:
    """Return one row per problem, solver and start; see `measure.rows_of`."""
    from . import measure

    rows = []
    for number, problem in enumerate(problems):
        rows += measure.rows_of(number, problem, who, study.most_rows)
    return pd.DataFrame(rows)


def main() -> None:
    """Run the study of the command line."""
    study = options.read(Study, __doc__)
    from . import measure, report
    from .solvers import solvers

    if study.quick:
        study = replace(study, problems=100, only=study.only or QUICK, most_rows=100)
    who = solvers()
    problems = captured(study, chosen(catalogue(), study.only))
    print(f"{len(problems)} problems of {len({problem.scene for problem in problems})} scenes")
    measure.warm_up(who, problems)
    table = run(study, tqdm(problems, desc="solving", unit="problem", disable=None), who)
    print(report.show(table))
    print(machine.one_line())
    report.write(table, study.out)


if __name__ == "__main__":
    main()
