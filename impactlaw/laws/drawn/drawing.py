"""Random numbers of laws that draw their outcomes: from a seed and the collision itself, so that a run repeats."""

from __future__ import annotations

import hashlib
import operator
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError
from impactlaw.mechanics.arrays import is_sparse
from impactlaw.mechanics.collision import Collision


def checked_seed(seed: int | None) -> int | None:
    """Return a seed as an int, or None.

    Raises:
        RestitutionError: it is no whole number of 0 or more.
    """
    if seed is None:
        return None
    try:
        number = operator.index(seed)
    except TypeError:
        raise RestitutionError(f"a seed must be a whole number, got {seed!r}") from None
    if number < 0:
        raise RestitutionError(f"a seed must be 0 or more, got {number}")
    return number


def generator(seed: int | None, collision: Collision) -> np.random.Generator:
    """Return the generator that belongs to a collision: the same one in every process.

    Args:
        seed: of the law; None for 0.
        collision: what collides; its J and v- are the rest of the seed.
    """
    J: Any = collision.jacobian
    J = np.ascontiguousarray(J.toarray() if is_sparse(J) else J)
    digest = hashlib.sha256(collision.pre_velocity.tobytes() + J.tobytes()).digest()
    return np.random.default_rng([seed or 0, int.from_bytes(digest[:8], "little")])
