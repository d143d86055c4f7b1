"""Small dense problems on one thread: starting BLAS threads takes longer than solving them.

On two busy cores a collision of 128 contacts takes 0.7 ms on one thread, and 17 to 110 ms on two. The number of threads
belongs to the whole process, so that it is changed only for as long as a step or a collision takes, at 8 us.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from typing import Any


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS uses one thread."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> Any:
    """Return what controls the threads of the BLAS libraries of numpy and scipy."""
    import_module("scipy.linalg")  # each brings its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
