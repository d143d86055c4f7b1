"""Stability: extreme and stiff cases under every law and solver, each with its verdict and the one it should have.

A verdict is computed from the study's own measurements (`stability_verdicts`), never from what the package says of its
own result: "right", "refused" (a typed error), "WRONG" (a silent error), "NaN", "HANGS" (over the case's time budget),
"CRASHES" (any other exception, or a floating-point warning). Every row runs in a process of its own. The exit code is 1
if any verdict is not the expected one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import machine
import pandas as pd
import tyro
from stability_cases import CASES
from stability_verdicts import REFUSED, Case
from stability_worker import Task, Worker
from tqdm import tqdm

MEASURED = ("residual", "energy", "penetration", "deviation")


@dataclass(frozen=True)
class Stability:
    """Which cases to run."""

    quick: bool = False
    """Shorten the long cases; under a minute, and what the tests run."""
    cases: tuple[str, ...] = ("*",)
    """Names of cases, or patterns such as "stack*"."""


def select(study: Stability) -> list[Case]:
    """Return the cases that the study names.

    Raises:
        ValueError: a pattern that no case matches.
    """
    for pattern in study.cases:
        if not any(fnmatch(name, pattern) for name in CASES):
            raise ValueError(f"no case matches {pattern!r}; known: {', '.join(CASES)}")
    return [case for name, case in CASES.items() if any(fnmatch(name, pattern) for pattern in study.cases)]


def run(study: Stability, progress: Callable[[str], object] = lambda name: None) -> pd.DataFrame:
    """Run the cases and return one row per case, law and solver.

    Columns: case, kind, law, solver, verdict, expected, as_expected, reason, expected_reason, residual, energy,
    penetration, deviation, collisions, seconds, note.
    """
    with Worker() as worker:
        rows = []
        for case in select(study):
            rows += run_case(case, study.quick, worker)
            progress(case.name)
    return pd.DataFrame(rows)


def run_case(case: Case, quick: bool, worker: Worker) -> list[dict[str, object]]:
    """Run one case under its laws, with its solvers, and return its rows."""
    rows = []
    for law in case.laws:
        for solver in case.solvers:
            outcome = worker.run(Task(case.name, law, solver, quick), case.budget)
            expected = case.expects(law, solver)
            found, m = outcome.verdict, outcome.measurement
            fits = expected.fits(found, outcome.reason)
            row: dict[str, object] = {"case": case.name, "kind": case.kind, "law": law, "solver": solver}
            row |= {"verdict": found, "expected": expected.verdict, "as_expected": fits}
            row |= {"reason": outcome.reason, "expected_reason": expected.reason}
            row |= {name: float("nan") if m is None else getattr(m, name) for name in MEASURED}
            row |= {"collisions": 0 if m is None else m.collisions, "seconds": outcome.seconds}
            notes = (m.note if m else "", case.shortened if quick else "")
            rows.append(row | {"note": "; ".join(filter(None, notes))})
    return rows


def format_table(table: pd.DataFrame) -> str:
    """Return one line per case with its verdicts and worst numbers, what is not as expected, and the refusals."""
    width = max(len("case"), table.case.str.len().max())
    head = f"{'case':<{width}}  {'verdicts':<22} residual   energy penetration deviation  slowest"
    lines = [head, "-" * len(head)]
    for name, rows in table.groupby("case", sort=False):
        counts = ", ".join(f"{count} {verdict}" for verdict, count in rows.verdict.value_counts().items())
        worst = [f"{rows[column].max():.1e}".replace("nan", "-") for column in MEASURED]
        numbers = "{:>9}{:>9}{:>12}{:>10}".format(*worst)
        lines.append(f"{name:<{width}}  {counts:<22}{numbers} {rows.seconds.max():7.2f}s")
        lines += [f"    {note}" for note in rows.note.unique() if note]
        unexpected = rows[~rows.as_expected]
        for found in unexpected.verdict.unique():
            some = unexpected.loc[unexpected.verdict == found]
            reason = " ".join(some.reason.iloc[0].split())
            expected = some.expected.iloc[0]
            lines.append(f"    NOT AS EXPECTED: {found} instead of {expected}: {_covered(some, rows)}: {reason}")
    return "\n".join([*lines, *_refusals(table)])


def _refusals(table: pd.DataFrame) -> list[str]:
    """Return one line per stated reason of a refusal."""
    refused = table[(table.verdict == REFUSED) & table.as_expected]
    lines = ["", "refused, as expected:"] if len(refused) else []
    for key in (refused.solver + ": " + refused.expected_reason).unique():
        some = refused.loc[refused.solver + ": " + refused.expected_reason == key]
        cases = some.case.unique()
        named = ", ".join(cases) if len(cases) <= 8 else f"{len(cases)} cases"
        lines.append(f"  {key} ({len(some)} rows: {named})")
    return lines


def _covered(some: pd.DataFrame, rows: pd.DataFrame) -> str:
    laws, solvers = some.law.unique(), some.solver.unique()
    law = "every law" if len(laws) == rows.law.nunique() else ", ".join(laws)
    return law if rows.solver.nunique() == 1 else f"{law}, {', '.join(solvers)}"


def main(study: Stability, out: Path = Path("out/stability")) -> None:
    """Run the study, print its table, and write every row as CSV, with the machine beside it.

    Args:
        study: what to run.
        out: folder for stability.csv.
    """
    try:
        chosen = select(study)
    except ValueError as error:
        sys.exit(str(error))
    with tqdm(total=len(chosen), disable=None, unit="case") as bar:

        def progress(name: str) -> None:
            bar.set_postfix_str(name, refresh=False)
            bar.update()

        table = run(study, progress)
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "stability.csv", index=False)
    print(format_table(table))
    unexpected = table[~table.as_expected]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in table.verdict.value_counts().items())
    print(f"\n{len(table)} rows of {table.case.nunique()} cases: {counts}; {len(unexpected)} not as expected")
    print(f"every row: {out / 'stability.csv'}; {machine.one_line()}")
    (out / "machine.txt").write_text(machine.one_line() + "\n")
    sys.exit(1 if len(unexpected) else 0)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__, config=(tyro.conf.OmitArgPrefixes,))
