"""Run jobs in processes of this machine, on a Dask or a Ray cluster, or in any other backend of joblib."""

# pyright: reportMissingImports=false
from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from impactlaw.errors import StudyError, UnknownNameError, check_installed

Jobs = Iterable[Callable[[], Any]]
PROCESSES, DASK, RAY = "loky", "dask", "ray"


@contextmanager
def workers(backend: str, address: str | None, jobs: int) -> Iterator[Callable[[Jobs], Iterator[Any]]]:
    """Yield a function that runs jobs and yields their results as they are done, in any order.

    Args:
        backend: "loky" for processes of this machine, "dask", "ray", or a name that joblib knows.
        address: address of the scheduler of a cluster; by default a cluster is started on this machine.
        jobs: number of jobs that run at a time; -1 for one per processor.

    Raises:
        UnknownNameError: there is no such backend.
        MissingExtraError: the backend needs a package that is not installed.
        StudyError: jobs is invalid, no cluster answers at the address, or the backend accepts no address.
    """
    check_workers(backend, address, jobs)
    with ExitStack() as stack:
        if backend == DASK:
            stack.enter_context(_dask(address, jobs))
        yield stack.enter_context(_ray(address, jobs) if backend == RAY else _joblib(backend, jobs))


def check_workers(backend: str, address: str | None, jobs: int) -> None:
    """Check the arguments of `workers` as far as possible before any process starts; raises the same errors."""
    import joblib
    from joblib.parallel import BACKENDS

    if not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise StudyError(f"jobs must be 1 or more, or -1 for one per processor, got {jobs!r}")
    if backend not in {*BACKENDS, DASK, RAY}:  # joblib registers the backend of Dask only on demand
        raise UnknownNameError("backend", backend, {*BACKENDS, DASK, RAY})
    if address is not None and backend not in (DASK, RAY):
        raise StudyError(f"an address means nothing to {backend!r}; it is that of a cluster of {DASK!r} or {RAY!r}")
    package = {DASK: "distributed", RAY: "ray"}.get(backend)
    if package is not None:
        check_installed(package, f"the backend {backend!r}", "cluster")
    else:
        with joblib.parallel_config(backend):
            _parallel(backend, jobs)


@contextmanager
def _joblib(backend: str, jobs: int) -> Iterator[Callable[[Jobs], Iterator[Any]]]:
    import joblib

    with joblib.parallel_config(backend):
        parallel = _parallel(backend, jobs)

        def results_of(calls: Jobs) -> Iterator[Any]:
            with _without_ctrl_c():  # processes that start here inherit the block, until they can end silently
                return parallel(joblib.delayed(call)() for call in calls)

        yield results_of


def _parallel(backend: str, jobs: int) -> Any:
    """Return joblib's parallel runner of jobs; its workers start with the first call."""
    import joblib

    # Ctrl-C also reaches the workers: let them end without printing a traceback
    quiet: dict[str, Any] = {"initializer": _end_silently} if backend == PROCESSES else {}
    try:
        return joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", **quiet)
    except ValueError as error:
        raise StudyError(f"backend {backend!r} does not give results as they are done: {error}") from None


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C during the context, here and in processes that start meanwhile."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # started before blocking, since its start would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_silently() -> None:
    """Let Ctrl-C end this process without a traceback, also if it was pressed during the start.

    A process in the background, which ignores Ctrl-C, continues to ignore it.
    """
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def _dask(address: str | None, jobs: int) -> Iterator[None]:
    from distributed import Client

    local: dict[str, Any] = {"threads_per_worker": 1, "dashboard_address": None}
    if jobs > 0:
        local["n_workers"] = jobs
    try:
        client = Client(address, timeout=30) if address is not None else Client(**local)
    except (OSError, ValueError) as error:
        raise StudyError(f"no Dask scheduler answers at {address}: {error}") from None
    with client:
        yield


@contextmanager
def _ray(address: str | None, jobs: int) -> Iterator[Callable[[Jobs], Iterator[Any]]]:
    """Use Ray's own pool, since Ray's backend for joblib returns results only when all are done."""
    import ray
    from ray.util.multiprocessing import Pool

    mine = not ray.is_initialized()
    try:
        if mine:
            cpus = None if address is not None or jobs < 0 else jobs
            ray.init(address or "local", num_cpus=cpus, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise StudyError(f"no Ray cluster answers at {address}: {error}") from None
    try:
        with Pool(None if jobs < 0 else jobs) as pool:
            yield lambda calls: pool.imap_unordered(_call, calls)
    finally:
        if mine:
            ray.shutdown()


def _call(call: Callable[[], Any]) -> Any:
    return call()
