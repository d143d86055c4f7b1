"""Study "work-precision": error of the trajectory against run time, for every way to step.

Writes tables (CSV) and pictures into a folder. Prints measured orders beside the expected ones, and how much smaller
the errors of event-driven and of time stepping are than the error of MuJoCo's best soft contact at equal run time.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import tyro
from tqdm import tqdm

from scripts import machine

from . import stepping
from .orders import OrderStudy, time_stepping_orders
from .pictures import COMPACT, draw
from .results import advantage, orders, where
from .stepping import SteppingStudy

QUICK_STEPPING = SteppingStudy(
    scenes=("bouncing ball", "cradle, Moreau", "falling rod", "sliding block", "rod with friction", "quadruped"),
    timesteps=(10**-1.5, 1e-2, 10**-2.5),
    methods=(
        *("event-driven RK4", "event-driven Euler", "time stepping", "soft layer RK4", "MuJoCo default RK4"),
        *("MuJoCo tuned 30 RK4", "MuJoCo tuned 100 Euler"),
    ),
    finest=10**-3.5,
)
QUICK_ORDERS = OrderStudy(scenes=QUICK_STEPPING.scenes, groups=3, neighbours=4)


@dataclass(frozen=True, kw_only=True)
class WorkPrecision:
    """Run the study; the columns of its tables are those of `stepping.run`, `orders` and `results`."""

    quick: bool = False
    """Run few scenes and timesteps, in seconds instead of minutes."""
    out: Path = Path("out/work_precision")
    """Folder for tables and pictures."""
    picture: Path | None = None
    """Also draw the small picture of four scenes into this file."""


@dataclass(frozen=True, eq=False)
class Results:
    """The tables of one run of the study.

    Attributes:
        stepping: see `stepping.run`.
        orders: see `results.orders`.
        time_stepping: see `orders.time_stepping_orders`.
        advantage: see `results.advantage`.
    """

    stepping: pd.DataFrame
    orders: pd.DataFrame
    time_stepping: pd.DataFrame
    advantage: pd.DataFrame


def run(study: WorkPrecision) -> Results:
    """Return all tables; show a progress bar if there is a terminal."""
    of_stepping = QUICK_STEPPING if study.quick else SteppingStudy()
    of_orders = QUICK_ORDERS if study.quick else OrderStudy()
    total = len(list(stepping.cells(of_stepping))) + len(of_orders.scenes)
    with tqdm(total=total, disable=None, unit="run") as bar:

        def progress(what: str) -> None:
            bar.set_description(what)
            bar.update()

        stepped = stepping.run(of_stepping, progress)
        of_time_stepping = time_stepping_orders(of_orders, progress)
    return Results(stepped, orders(stepped), of_time_stepping, advantage(stepped))


def write(results: Results, study: WorkPrecision) -> None:
    """Write every table as CSV, the machine beside them, and the pictures."""
    study.out.mkdir(parents=True, exist_ok=True)
    for name in ("stepping", "orders", "time_stepping", "advantage"):
        getattr(results, name).to_csv(study.out / f"{name}.csv", index=False)
    footer, stepped = machine.one_line(), results.stepping
    (study.out / "machine.txt").write_text(footer + "\n")
    draw(stepped, study.out / "stepping.png", footer)
    draw(where(stepped, stepped.scene.isin(COMPACT)), study.picture or study.out / "compact.png", footer)


def show(results: Results) -> str:
    """Return the tables that fit on a screen."""
    number: Any = "{:.3g}".format
    parts = (
        ("Orders in the timestep (expected 0: exact where the error is rounding, else not convergent)", results.orders),
        ("Order of time stepping, over timesteps close to each other", results.time_stepping),
        ("Error of MuJoCo's best soft contact over that of rigid stepping, at equal run time", results.advantage),
    )
    texts = [f"{title}\n{table.to_string(index=False, float_format=number, na_rep='')}" for title, table in parts]
    return "\n\n".join([*texts, machine.one_line()])


def main() -> None:
    """Run the study from the command line."""
    study = tyro.cli(WorkPrecision, description=__doc__)
    results = run(study)
    write(results, study)
    print(show(results))
    print(f"in {study.out}: {', '.join(sorted(path.name for path in study.out.iterdir()))}")


if __name__ == "__main__":
    main()
