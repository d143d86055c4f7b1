"""The study's tables: as text on the screen, as files in full."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .case import FINE, NO_CONTROLS, NOT_LOADED
from .verdicts import cases, failures, verdicts
from .ways import WAYS

Values = Sequence[float]
_WORST: dict[str, Callable[[Values], float]] = {
    "nv": max,
    "steps": min,
    **dict.fromkeys(("mean_us", "ratio", "largest_ms", "over_mean", "depth", "limit", "growth"), max),
    "met": min,
    "short": max,
    "unlocated": sum,
}
_WIDEST = 100  # characters of an outcome on the screen


def by_scene(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene and way with the worst over laws and starts; fine: cases that took all steps."""
    rows = cases(table)
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: WAYS.index(row["way"])):
        groups.setdefault((row["scene"], row["way"]), []).append(row)
    order = list(dict.fromkeys(row["scene"] for row in rows))
    shown = [_worst(scene, way, group) for (scene, way), group in groups.items()]
    return pd.DataFrame(sorted(shown, key=lambda row: order.index(str(row["scene"]))))


def _worst(scene: str, way: str, rows: list[dict[str, Any]]) -> dict[str, object]:
    fine = sum(row["outcome"] == FINE for row in rows)
    found: dict[str, object] = {"scene": scene, "way": way, "fine": f"{fine}/{len(rows)}"}
    for name, worst in _WORST.items():
        values = _known(rows, name)
        found[name] = worst(values) if values else np.nan
    said = [row["stands"] for row in rows if row.get("stands") in ("yes", "no")]
    return found | {"stands": "-" if not said else min(said)}


def _known(rows: list[dict[str, Any]], name: str) -> list[float]:
    return [row[name] for row in rows if not pd.isna(row.get(name, np.nan))]


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per way: how many cases are fine, and medians and extremes of cost and depth."""
    rows = []
    for way in WAYS:
        group = [row for row in cases(table) if row["way"] == way]
        if not group:
            continue
        found = {"way": way, "cases": len(group), "fine": sum(row["outcome"] == FINE for row in group)}
        for name in ("ratio", "largest_ms", "depth"):
            values = _known(group, name) or [np.nan]
            found |= {f"median {name}": np.median(values), f"largest {name}": max(values)}
        rows.append(found)
    return pd.DataFrame(rows)


def show(table: pd.DataFrame) -> str:
    """Return all tables as text."""
    parts = [_text(by_scene(table)), *_left_out(table)]
    failed = failures(table)
    if len(failed):
        failed["outcome"] = failed["outcome"].str.slice(0, _WIDEST)
        parts += ["", "Cases that stopped", _text(failed)]
    parts += ["", "Ways", _text(summary(table))]
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
    folder.mkdir(parents=True, exist_ok=True)
    kept = table.loc[table["outcome"] != NO_CONTROLS]
    kept.to_csv(folder / "robots.csv", index=False)
    kept.to_parquet(folder / "robots.parquet", index=False)
    verdicts(table).to_csv(folder / "goals.csv", index=False)
