"""Checks of arrays: collisions keep read-only copies in double precision, with finite entries and the right shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError


def real_array(values: ArrayLike) -> np.ndarray:
    """Return a copy in double precision."""
    array = np.array(values)
    if array.dtype.kind == "c":
        raise TypeError("real numbers are needed, not complex ones")
    return array if array.dtype == np.float64 else array.astype(float)


def finite_array(
    values: ArrayLike, name: str, shape: tuple[int | str, ...] | None = None, like: str = ""
) -> np.ndarray:
    """Return a read-only copy in double precision; `InvalidCollisionError` if entries or shape are wrong.

    If the first entry of ``shape`` is a string such as "h", any length is right there; None means any shape. ``name``
    and ``like``, the reason for the shape, are for the message.
    """
    try:
        array = real_array(values)
    except (TypeError, ValueError) as error:
        raise InvalidCollisionError(f"{name} is not an array of numbers: {error}") from None
    if np.count_nonzero(np.isfinite(array)) != array.size:  # faster than all(), and every collision runs this
        raise InvalidCollisionError(f"{name} has entries that are not finite")
    array.flags.writeable = False
    return array if shape is None else of_shape(array, name, shape, like)


def of_shape(array: Any, name: str, shape: tuple[int | str, ...], like: str = "") -> Any:
    """Return the array, which may be sparse, if it has this shape, see `finite_array`."""
    found, rest = array.shape, shape[1:]
    if found != shape and not (isinstance(shape[0], str) and len(found) == len(shape) and found[1:] == rest):
        wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        raise InvalidCollisionError(f"{name} must have shape {wanted}{like}, got {found}")
    return array


def is_sparse(values: Any) -> bool:
    """Whether the values are a scipy.sparse matrix or array; does not import scipy.sparse."""
    return hasattr(values, "tocsr")


def finite_sparse(values: Any, name: str) -> Any:
    """Return a copy as a read-only CSR array in double precision, without entries that are zero."""
    try:
        array = scipy.sparse.csr_array(values, copy=True)
        array.data = real_array(array.data)
    except (TypeError, ValueError) as error:
        raise InvalidCollisionError(f"{name} is not a matrix of numbers: {error}") from None
    array.sum_duplicates()
    if not np.isfinite(array.data).all():
        raise InvalidCollisionError(f"{name} has entries that are not finite")
    array.eliminate_zeros()
    for name in ("data", "indices", "indptr"):
        part = getattr(array, name).copy()
        part.flags.writeable = False
        setattr(array, name, part)
    return array
