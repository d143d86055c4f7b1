"""Stability: extreme and stiff cases under every law and solver, each with its verdict and the expected one.

A verdict is computed from the study's own measurements (`scripts.stability.verdicts`), never from the package's report
on its own result: "right", "refused" (a typed error), "WRONG" (a silent error), "NaN", "HANGS" (over the case's time
budget), "CRASHES" (any other exception, or a floating-point warning). Rows are measured in a separate process. The exit
code is 1 if any verdict is not the expected one.
"""

import sys
import time
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from scripts import machine, options
from scripts.apart import Worker

from .cases import CASES
from .verdicts import MEASURED, REFUSED, Case
from .worker import judged, prepare


@dataclass(frozen=True, kw_only=True)
class Stability:
    """Which cases to run."""

    quick: bool = False
    """Shorten the long cases, so that all take less than a minute; the tests run this form."""
    cases: tuple[str, ...] = ("*",)
    """Names of cases, or patterns such as "stack*"."""
    out: Path = Path("out/stability")
    """Folder for stability.csv."""


def select(study: Stability) -> list[Case]:
    """Return the cases that the study names; a pattern that matches no case ends the program."""
    for pattern in study.cases:
        if not any(fnmatch(name, pattern) for name in CASES):
            raise SystemExit(f"no case matches {pattern!r}; known: {', '.join(CASES)}")
    return [case for name, case in CASES.items() if any(fnmatch(name, pattern) for pattern in study.cases)]


def run(cases: list[Case], quick: bool) -> pd.DataFrame:
    """Run the cases and return one row per case, law and solver; show a progress bar if there is a terminal.

    Columns: case, kind, law, solver, verdict, expected, as_expected, reason, expected_reason, residual, energy,
    penetration, deviation, collisions, seconds, note.
    """
    with Worker(prepare) as worker:
        bar = tqdm(cases, disable=None, unit="case")
        return pd.DataFrame([row for case in bar for row in run_case(case, quick, worker)])


def run_case(case: Case, quick: bool, worker: Worker) -> list[dict[str, object]]:
    """Run one case under its laws, with its solvers, and return its rows."""
    rows = []
    for law in case.laws:
        for solver in case.solvers:
            begin, expected = time.perf_counter(), case.expects(law, solver)
            found, reason, m = judged(worker, case.name, law, solver, quick, budget=case.budget)
            seconds = time.perf_counter() - begin
            fits = expected.fits(found, reason)
            row: dict[str, object] = {"case": case.name, "kind": case.kind, "law": law, "solver": solver}
            row |= {"verdict": found, "expected": expected.verdict, "as_expected": fits}
            row |= {"reason": reason, "expected_reason": expected.reason}
            row |= {name: float("nan") if m is None else getattr(m, name) for name in MEASURED}
            row |= {"collisions": 0 if m is None else m.collisions, "seconds": seconds}
            rows.append(row | {"note": m.note if m else ""})
    return rows


def format_table(table: pd.DataFrame) -> str:
    """Return one line per case with its verdicts and worst numbers, then the unexpected verdicts, then the refusals."""
    cases = [
        {"case": name, "verdicts": _counted(rows.verdict)}
        | {column: rows[column].max() for column in (*MEASURED, "seconds", "note")}
        for name, rows in table.groupby("case", sort=False)
    ]
    refused = table.loc[(table.verdict == REFUSED) & table.as_expected]
    unexpected = table.loc[~table.as_expected].drop_duplicates(["case", "verdict", "expected"])
    lines = [pd.DataFrame(cases).to_string(index=False, float_format=lambda x: f"{x:.1e}", na_rep="-")]
    for row in unexpected.to_dict("records"):
        where = f"{row['case']}, {row['law']}, {row['solver']}"
        lines.append(f"NOT AS EXPECTED: {row['verdict']} instead of {row['expected']}: {where}: {row['reason']}")
    if len(refused):
        reasons = refused.groupby(["solver", "expected_reason"]).agg(cases=("case", "nunique"), rows=("case", "size"))
        lines += ["", "refused, as expected:", reasons.to_string()]
    return "\n".join(lines)


def _counted(found: pd.Series) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in found.value_counts().items())


def main(study: Stability) -> None:
    """Run the study, print its table, and write every row as CSV, with a description of the machine."""
    table = run(select(study), study.quick)
    machine.write({"stability": table}, study.out)
    print(format_table(table))
    unexpected = int((~table.as_expected).sum())
    print(
        f"\n{len(table)} rows of {table.case.nunique()} cases: {_counted(table.verdict)}; {unexpected} not as expected"
    )
    print(f"every row: {study.out / 'stability.csv'}; {machine.one_line()}")
    sys.exit(1 if unexpected else 0)


if __name__ == "__main__":
    main(options.read(Stability, __doc__))
