"""Transfer matrices: the scores of policies under laws other than their own, and the regret of acting under them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impactlaw.errors import StudyError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferMatrix:
    """Scores of one task and scheme, with a row per policy and a column per law under which the policies act.

    The score of an entry is the mean over seeds of the cells' mean returns. Its interval is Student's t over seeds,
    ``mean +- t s / sqrt(n)`` with n - 1 degrees of freedom; NaN for one seed. The regret is the best mean in the column
    minus the entry. Its interval is that of the differences seed by seed, since a seed plays the same episodes for both
    policies. The best policy is chosen by the same scores, so regrets tend to be too large rather than too small.

    Attributes:
        task: id of the task.
        scheme: way to step.
        score: scores; rows are policies, columns are laws.
        half: half widths of the intervals of the scores.
        regret: regrets, in the same form.
        regret_half: half widths of the intervals of the regrets; NaN for the best policy of a column.
        seeds: number of seeds.
        confidence: confidence of the intervals.
    """

    task: str
    scheme: str
    score: pd.DataFrame
    half: pd.DataFrame
    regret: pd.DataFrame
    regret_half: pd.DataFrame
    seeds: int
    confidence: float

    def to_frame(self) -> pd.DataFrame:
        """Return a table with one row per entry.

        Columns: task, scheme, policy, acted_under, score, half, regret, regret_half, seeds.
        """
        import pandas as pd

        parts = {name: getattr(self, name).stack(future_stack=True) for name in _NUMBERS}
        table = pd.DataFrame(parts).rename_axis(["policy", "acted_under"]).reset_index()
        table.insert(0, "task", self.task)
        table.insert(1, "scheme", self.scheme)
        return table.assign(seeds=self.seeds)

    def to_markdown(self) -> str:
        """Return tables of scores, with the best of each column in bold, and of regrets, see `shown`."""
        shown = self.shown()
        if len(self.score) > 1:
            shown["score"] = shown["score"].where(self.regret > 0, "**" + shown["score"] + "**")
        return "\n\n".join([self.title(), *(_markdown(what, table) for what, table in shown.items())]) + "\n"

    def shown(self) -> dict[str, pd.DataFrame]:
        """Return scores, and regrets if there is more than one policy, as texts with their intervals."""
        digits = decimals(self.score.to_numpy())
        texts = {"score": _texts(self.score, self.half, digits)}
        return texts if len(self.score) == 1 else texts | {"regret": _texts(self.regret, self.regret_half, digits)}

    def title(self) -> str:
        """Return a title that describes the numbers."""
        spread = f"{self.confidence:.0%} t intervals over {self.seeds} seeds" if self.seeds > 1 else "one seed"
        return f"{self.task}, {self.scheme}: mean return, {spread}"

    def __str__(self) -> str:
        tables = self.shown().items()
        named = [table.rename_axis(columns=f"{what} under", index=None).to_string() for what, table in tables]
        return "\n\n".join([self.title(), *named])


_COLUMNS = {"task", "scheme", "policy", "trained_under", "acted_under", "seed", "score"}
_NUMBERS = ("score", "half", "regret", "regret_half")


def transfer_matrix(
    table: pd.DataFrame, *, task: str | None = None, scheme: str | None = None, confidence: float = 0.95
) -> TransferMatrix:
    """Return the transfer matrix of a task and a scheme.

    Args:
        table: a table returned by `impactlaw.studies.run`.
        task: id of the task; required if the table has several.
        scheme: way to step; required if the table has several for the task.
        confidence: confidence of the intervals.

    Raises:
        StudyError: the table is not that of a study, does not determine one task and scheme, lacks cells or has cells
            twice, or confidence is not between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise StudyError(f"confidence lies between 0 and 1, got {confidence!r}")
    _check_columns(table)
    for column, asked in (("task", task), ("scheme", scheme)):
        known = list(table[column].unique())
        if asked is not None and asked not in known:
            raise StudyError(f"the table has no {column} {asked!r}; it has {', '.join(known)}")
        if asked is None and len(known) > 1:
            raise StudyError(f"the table has several: state {column}=, one of {', '.join(known)}")
        table = table if asked is None else table.loc[table[column] == asked]
    if table.empty:
        raise StudyError("the table is empty")
    rows = _row_names(table)
    table = table.assign(row=rows)
    _check_once(table)
    cube = table.pivot(index=["row", "acted_under"], columns="seed", values="score")
    rows, columns = list(dict.fromkeys(rows)), list(table["acted_under"].unique())
    cube = cube.reindex([(row, column) for row in rows for column in columns])
    scores = cube.to_numpy().reshape(len(rows), len(columns), -1)
    if np.isnan(scores).any():
        raise StudyError("the table lacks cells: each policy needs each law and each seed")
    return _matrix(scores, rows, columns, str(table["task"].iloc[0]), str(table["scheme"].iloc[0]), confidence)


def transfer_matrices(table: pd.DataFrame, *, confidence: float = 0.95) -> Iterator[TransferMatrix]:
    """Yield the transfer matrices of all tasks and schemes; see `transfer_matrix`."""
    _check_columns(table)
    for task, scheme in table[["task", "scheme"]].drop_duplicates().itertuples(index=False):
        yield transfer_matrix(table, task=task, scheme=scheme, confidence=confidence)


def _check_columns(table: pd.DataFrame) -> None:
    if lacking := sorted(_COLUMNS - set(getattr(table, "columns", ()))):
        raise StudyError(f"this is not the table of a study: it has no column {', '.join(lacking)}")


def _check_once(table: pd.DataFrame) -> None:
    cell = ["row", "acted_under", "seed"]
    twice = table.loc[table.duplicated(cell), cell]
    if len(twice):
        row, acted, seed = twice.to_numpy()[0]
        raise StudyError(
            f"the table has more than one cell of {row} under {acted}, seed {seed}; take the table of one study"
        )


def _matrix(
    scores: np.ndarray, rows: list[str], columns: list[str], task: str, scheme: str, confidence: float
) -> TransferMatrix:
    """Return the transfer matrix of scores, (rows, columns, seeds)."""
    import pandas as pd

    mean = scores.mean(axis=2)
    best = np.take_along_axis(scores, mean.argmax(axis=0)[None, :, None], axis=0)
    difference = best - scores
    regret_half = half_interval(difference, confidence)
    regret_half[mean.argmax(axis=0), np.arange(len(columns))] = math.nan

    values = mean, half_interval(scores, confidence), difference.mean(axis=2), regret_half
    named = pd.Index(rows, name="policy"), pd.Index(columns, name="acted_under")
    frames = {name: pd.DataFrame(value, *named) for name, value in zip(_NUMBERS, values, strict=True)}
    return TransferMatrix(task=task, scheme=scheme, **frames, seeds=scores.shape[2], confidence=confidence)


def half_interval(values: np.ndarray, confidence: float) -> np.ndarray:
    """Return half of Student's t interval of the mean over the last axis; NaN if its length is one."""
    from scipy.stats import t

    n = values.shape[-1]
    if n < 2:
        return np.full(values.shape[:-1], math.nan)
    return t.ppf(0.5 + 0.5 * confidence, n - 1) * values.std(axis=-1, ddof=1) / math.sqrt(n)


def _row_names(table: pd.DataFrame) -> list[str]:
    """Return the name of each row: the law that its policy is made for, preceded by the policy if there are several."""
    pairs = list(zip(table["policy"], table["trained_under"], strict=True))
    several = len({name for name, _ in pairs}) > 1
    return [f"{name}, {law}" if several and law else law or name for name, law in pairs]


def decimals(values: np.ndarray) -> int:
    """Return the number of decimals with which the largest value has three digits."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    return 0 if largest == 0 else max(0, 2 - math.floor(math.log10(largest)))


def entry(value: float, half: float, digits: int) -> str:
    """Return a number as text, with half of its interval unless that is NaN."""
    text = f"{value + 0.0:.{digits}f}"
    return text if math.isnan(half) else f"{text} ± {half:.{digits}f}"


def _texts(value: pd.DataFrame, half: pd.DataFrame, digits: int) -> pd.DataFrame:
    shown = value.astype(object)
    for i, j in np.ndindex(*value.shape):
        shown.iloc[i, j] = entry(value.iloc[i, j], half.iloc[i, j], digits)
    return shown


def _markdown(what: str, table: pd.DataFrame) -> str:
    rows = [[f"{what} of, under", *table.columns], *([name, *row] for name, row in table.T.items())]
    head, *lines = ("| " + " | ".join(str(cell).replace("|", r"\|") for cell in row) + " |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *lines])
