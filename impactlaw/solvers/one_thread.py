"""Solve small dense problems on one thread, since starting BLAS threads takes longer than solving them.

On two busy cores a collision of 128 contacts takes 0.7 ms on one thread, and 17 to 110 ms on two. The number of threads
is a setting of the whole process. Therefore it is changed only for the duration of a step or a collision; this takes
8 us.
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
    """Return a controller of the threads of the BLAS libraries of numpy and scipy."""
    import_module("scipy.linalg")  # loads scipy's own BLAS, so that the controller finds it
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
