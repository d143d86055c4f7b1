"""Study "work-precision": error of the trajectory against run time, for every way to step.

Writes tables (CSV) and pictures into a folder. Prints measured orders beside the expected ones, and how much smaller
the errors of event-driven and of time stepping are than the error of MuJoCo's best soft contact at equal run time.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from scripts import machine, options

from . import stepping
from .orders import time_stepping_orders
from .pictures import COMPACT, draw
from .results import advantage, orders, where

_QUICK_SCENES = "bouncing ball", "cradle, Moreau", "falling rod", "sliding block", "rod with friction", "quadruped"
_QUICK_CELLS: dict[str, Any] = {
    "scenes": _QUICK_SCENES,
    "timesteps": (10**-1.5, 1e-2, 10**-2.5),
    "methods": (
        *("event-driven RK4", "event-driven Euler", "time stepping", "soft layer RK4", "MuJoCo default RK4"),
        *("MuJoCo tuned 30 RK4", "MuJoCo tuned 100 Euler"),
    ),
    "finest": 10**-3.5,
}
_QUICK_ORDERS: dict[str, Any] = {"scenes": _QUICK_SCENES, "groups": 3, "neighbors": 4}


@dataclass(frozen=True, kw_only=True)
class WorkPrecision:
    """Run the study; the columns of its tables are those of `stepping.run`, `orders` and `results`."""

    quick: bool = False
    """Run few scenes and timesteps, in seconds instead of minutes."""
    out: Path = Path("out/work_precision")
    """Folder for tables and pictures."""


def run(study: WorkPrecision) -> dict[str, pd.DataFrame]:
    """Return all tables; show progress bars if there is a terminal.

    The tables are "stepping" (`stepping.run`), "orders" (`results.orders`), "time_stepping"
    (`orders.time_stepping_orders`) and "advantage" (`results.advantage`).
    """
    cells = list(stepping.cells(**_QUICK_CELLS if study.quick else {}))
    stepped = pd.DataFrame(tqdm(stepping.run(cells), total=len(cells), unit="run", disable=None))
    of_orders = time_stepping_orders(**_QUICK_ORDERS if study.quick else {})
    measured = pd.DataFrame(tqdm(of_orders, unit=" scenes", disable=None))
    return {
        "stepping": stepped, "orders": orders(stepped), "time_stepping": measured, "advantage": advantage(stepped),
    }  # fmt: skip


def write(tables: dict[str, pd.DataFrame], study: WorkPrecision) -> None:
    """Write every table as CSV, the machine beside them, and the pictures."""
    machine.write(tables, study.out)
    footer, stepped = machine.one_line(), tables["stepping"]
    draw(stepped, study.out / "stepping.png", footer)
    draw(where(stepped, stepped.scene.isin(COMPACT)), study.out / "compact.png", footer)


def show(tables: dict[str, pd.DataFrame]) -> str:
    """Return the tables that fit on a screen."""
    number: Any = "{:.3g}".format
    titles = {
        "orders": "Orders in the timestep (expected 0: exact where the error is rounding, else not convergent)",
        "time_stepping": "Order of time stepping, over timesteps close to each other",
        "advantage": "Error of MuJoCo's best soft contact over that of rigid stepping, at equal run time",
    }
    texts = [
        f"{title}\n{tables[name].to_string(index=False, float_format=number, na_rep='')}"
        for name, title in titles.items()
    ]
    return "\n\n".join([*texts, machine.one_line()])


def main() -> None:
    """Run the study from the command line."""
    study = options.read(WorkPrecision, __doc__)
    tables = run(study)
    write(tables, study)
    print(show(tables))
    print(f"in {study.out}: {', '.join(sorted(path.name for path in study.out.iterdir()))}")


if __name__ == "__main__":
    main()
