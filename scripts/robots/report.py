"""Tables of the study: as text on the screen, and in full as files."""

from pathlib import Path
from typing import Any

import pandas as pd

from .case import FINE, NO_CONTROLS, NOT_LOADED
from .verdicts import cases, failures, verdicts
from .ways import WAYS

_WORST: dict[str, Any] = {
    "nv": "max",
    "steps": "min",
    **dict.fromkeys(("mean_us", "ratio", "largest_ms", "over_mean", "depth", "limit", "growth"), "max"),
    "met": "min",
    "short": "max",
    "unlocated": lambda found: found.sum(min_count=1),
    "counted": "max",
}
_WIDEST = 100  # largest number of characters of an outcome on the screen


def by_scene(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene and way with the worst values over laws and starts; fine counts complete cases."""
    told = cases(table).reindex(columns=["scene", "way", "outcome", *_WORST])
    told["way"] = pd.Categorical(told.way, list(WAYS))
    told["scene"] = pd.Categorical(told.scene, list(dict.fromkeys(told.scene)))
    groups: Any = told.groupby(["scene", "way"], observed=True)
    shown = groups[list(_WORST)].agg(_WORST)
    shown.insert(0, "fine", groups.outcome.agg(lambda found: f"{(found == FINE).sum()}/{len(found)}"))
    return shown.reset_index()


def show(table: pd.DataFrame) -> str:
    """Return all tables as text."""
    parts = [_text(by_scene(table)), *_left_out(table)]
    failed = failures(table)
    if len(failed):
        failed["outcome"] = failed["outcome"].str.slice(0, _WIDEST)
        parts += ["", "Cases that stopped", _text(failed)]
    if "time-stepping" in table["way"].tolist():
        parts += ["", "Goals of time stepping", *_lines(verdicts(table))]
    return "\n".join(parts)


def _left_out(table: pd.DataFrame) -> list[str]:
    said = {row["scene"]: row["outcome"] for row in table.to_dict("records") if NOT_LOADED in str(row["outcome"])}
    return [f"{scene} is left out: {outcome[:_WIDEST]}" for scene, outcome in said.items()]


def _lines(goals: pd.DataFrame) -> list[str]:
    said = {"yes": "met", "no": "NOT MET", "-": "not measured"}
    lines = []
    for row in goals.to_dict("records"):
        of = f" (so in {row['cases'] - row['missed']} of {row['cases']} cases)" if row["cases"] else ""
        line = f"{said[row['met']]:8} {row['goal']}{of}"
        lines.append(f"{line}: {row['worst']}" if row["worst"] else line)
    return lines


def _text(table: pd.DataFrame) -> str:
    return table.to_string(index=False, float_format=_number, na_rep="-")


def _number(x: float) -> str:
    return f"{x:.0f}" if abs(x) < 1e6 and x == round(x) else f"{x:.3g}"


def write(table: pd.DataFrame, folder: Path) -> None:
    """Write all cases as CSV and parquet, and the goals as CSV."""
    kept = table.loc[table["outcome"] != NO_CONTROLS]
    kept.to_csv(folder / "robots.csv", index=False)
    kept.to_parquet(folder / "robots.parquet", index=False)
    verdicts(table).to_csv(folder / "goals.csv", index=False)
