"""Small dense problems on one thread: starting BLAS threads takes longer than solving them.

Measured on two cores that others use, too (OpenBLAS 0.3): a collision of 128 contacts takes 0.7 ms on one thread, and
17 to 110 ms on two. How many threads BLAS uses is a setting of the whole process, so that it is changed for as long as
a step or a collision takes, at 8 us, and not when the package is imported: what the user computes in between keeps it.
Where several threads step at the same time, threadpoolctl lets one of them change it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS use one thread meanwhile."""
    before = [(library, library.get_num_threads()) for library in _libraries()]
    several = [(library, threads) for library, threads in before if threads != 1]
    for library, _ in several:
        library.set_num_threads(1)
    try:
        yield
    finally:
        for library, threads in several:
            library.set_num_threads(threads)


@cache
def _libraries() -> list[Any]:
    """Return the BLAS libraries of numpy and scipy."""
    import_module("scipy.linalg")  # each brings its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas").lib_controllers
