"""How time and memory grow with the number of contacts: the exponents between one size and the next."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from math import log
from typing import Any

import pandas as pd


def growth(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return one row per quantity and step in size.

    Columns: quantity, smaller, larger (sizes), factor (by which the quantity grows), exponent p of ``size^p``.
    """
    rows = []
    for quantity, values in series(tables).items():
        for (smaller, before), (larger, after) in pairwise(sorted(values)):
            factor = after / before
            exponent = log(factor) / log(larger / smaller)
            rows.append([quantity, int(smaller), int(larger), factor, exponent])
    return pd.DataFrame(rows, columns=["quantity", "smaller", "larger", "factor", "exponent"])


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dictionary per row."""
    return [dict(zip(table.columns, values, strict=True)) for values in table.to_numpy(dtype=object)]


def series(tables: dict[str, pd.DataFrame]) -> dict[str, list[tuple[float, float]]]:
    """Return what was measured at several sizes, (size, value), by the name of the quantity."""
    found: dict[str, list[tuple[float, float]]] = {}
    for name, read in (("laws", _of_law), ("chains", _of_chain), ("steps", _of_step), ("memory", _of_memory)):
        for row in records(tables[name]) if name in tables else ():
            for quantity, size, value in read(row):
                found.setdefault(quantity, []).append((float(size), float(value)))
    return found


def _of_law(row: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    if row["solver"] == "auto":
        yield f"time of {row['law']} against contacts, {row['kind']}", row["h"], row["law_us"]


def _of_chain(row: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    if row["outcome"] == "solved":
        yield f"time of {row['solver']} against contacts, {row['chain']} chain", row["h"], row["milliseconds"]


def _of_step(row: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    if row["phase"] == "all" and re.fullmatch(r"cradle \d+", row["scene"]):
        yield f"time of a {row['contact_model']} step against balls, cradle", row["nv"], row["median_us"]
        if row["contact_model"] == "rigid":
            yield "time of mj_step against balls, cradle", row["nv"], row["mj_median_us"]


def _of_memory(row: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    if row["size"] > 0:
        yield f"Python's peak memory, {row['case']}", row["size"], row["python_peak_mb"]
