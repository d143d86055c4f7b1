"""Run a study: compute the missing cells, each once, and return a table with one row per cell."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from impactlaw.errors import StudyError
from impactlaw.studies.backends import PROCESSES, Jobs, check_workers, workers
from impactlaw.studies.store import Store, write
from impactlaw.studies.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from impactlaw.studies.cells import Cell, Training

_SHOWN = 3  # number of failures that an error names


def run(
    study: Study, folder: str | Path, *, backend: str = PROCESSES, address: str | None = None, jobs: int = -1
) -> pd.DataFrame:
    """Run the cells of a study that are not in the folder yet, and return the table with one row per cell.

    Finished cells and trained policies are written immediately (`Store`), so that a study that was stopped in any way
    continues where it was. The table is the same from every backend, to the last bit, and is written to
    ``table.parquet``. A cell that fails does not stop the others.

    Columns: task, scheme, policy, trained_under, acted_under, seed, episodes; those of `impactlaw.studies.play.play`;
    cell and trained, the names of the files of the cell and of the trained policy.

    Args:
        study: the study.
        folder: folder of its files.
        backend: "loky" for processes of this machine, "dask" or "ray" for clusters, or a name that joblib knows.
        address: address of the cluster; by default a cluster is started on this machine.
        jobs: number of cells that run at a time; -1 for one per processor.

    Raises:
        StudyError: study is not a `Study`, does not fit its tasks, or cells have failed; finished cells are kept.
        UnknownNameError: there is no such backend.
        MissingExtraError: a policy or the backend needs a package that is not installed.
        ImpactLawError: a law does not fit a task.
    """
    from impactlaw.studies.cells import cells_of

    if not isinstance(study, Study):
        raise StudyError(f"a study is an impactlaw.studies.Study, got {study!r:.100}")
    check_workers(backend, address, jobs)
    cells = list(cells_of(study))
    store = Store(Path(folder))
    missing = {cell.key: cell for cell in cells if store.row(cell.key) is None}
    untrained = {t.key: t for cell in missing.values() if (t := cell.training) and store.policy(t.key) is None}
    _check(missing.values())
    store.make()
    if missing:
        done = len({cell.key for cell in cells}) - len(missing)
        with (
            workers(backend, address, jobs) as results_of,
            tqdm(total=done + len(missing) + len(untrained), initial=done, unit="cell", disable=None) as bar,
        ):
            failed = _finish(untrained, store, results_of, bar)
            ready = {k: c for k, c in missing.items() if c.training is None or store.policy(c.training.key)}
            failed += _finish(ready, store, results_of, bar)
        if failed:
            more = f", and {len(failed) - _SHOWN} more" if len(failed) > _SHOWN else ""
            cells_failed = "1 cell has failed" if len(failed) == 1 else f"{len(failed)} cells have failed"
            raise StudyError(f"{cells_failed}, the others are kept: {'; '.join(failed[:_SHOWN])}{more}")
    return _table(cells, store)


def _check(cells: Iterable[Cell]) -> None:
    """Make each environment of the study once and take a step, so that errors are raised before any cell runs."""
    each = (part.conditions for cell in cells for part in (cell, cell.training) if part is not None)
    for one in {str(one.settings()): one for one in each}.values():
        env = one.make()
        env.reset(seed=0)
        env.step(env.action_space.sample())
        env.close()


def _finish(
    todo: Mapping[str, Cell | Training], store: Store, results_of: Callable[[Jobs], Iterator[Any]], bar: tqdm
) -> list[str]:
    """Run all of these cells or trainings, store the results, and return descriptions of those that failed."""
    from impactlaw.studies.cells import Cell, job

    def job_of(one: Cell | Training) -> Callable[[], Any]:
        path = store.policy(one.training.key) if isinstance(one, Cell) and one.training else None
        return job(one, path and path.read_bytes())

    jobs = map(job_of, todo.values())
    failed = []
    for key, result, failure in results_of(jobs):
        bar.update()
        if failure is not None:
            failed.append(failure)
        else:
            keep = store.keep_row if isinstance(todo[key], Cell) else store.keep_policy
            keep(key, todo[key].settings, result)
    return failed


def _table(cells: Iterable[Cell], store: Store) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for cell in cells:
        files = {"cell": cell.key, "trained": "" if cell.training is None else cell.training.key}
        rows.append(cell.names() | (store.row(cell.key) or {}) | files)
    table = pd.DataFrame(rows)
    file = io.BytesIO()
    table.to_parquet(file, index=False)
    write(store.folder / "table.parquet", file.getvalue())
    return table
