"""The base of laws with random outcomes, drawn from a seed and the collision itself so that runs can be repeated."""

from __future__ import annotations

import hashlib
import operator
from dataclasses import replace
from typing import Any, Self

import numpy as np

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law
from impactlaw.mechanics.arrays import is_sparse
from impactlaw.mechanics.collision import Collision


class DrawnLaw(Law):
    """A law whose random outcomes are determined by its seed and the numbers of the collision.

    The same collision has the same outcome in every process, so that a run can be repeated. Subclasses declare the seed
    as their last field: as a field of this class it would precede theirs.

    Attributes:
        seed: a whole number, 0 or more. None acts as 0, but environments then draw a new seed for each episode.

    Raises:
        RestitutionError: the seed is not a whole number of at least 0.
    """

    seed: int | None

    def __post_init__(self):
        if self.seed is None:
            return
        try:
            seed = operator.index(self.seed)
        except TypeError:
            raise RestitutionError(f"a seed must be a whole number, got {self.seed!r}") from None
        if seed < 0:
            raise RestitutionError(f"a seed must be 0 or more, got {seed}")
        object.__setattr__(self, "seed", seed)

    def seeded(self, seed: int) -> Self:
        """Return the law with this seed, or the law itself if it has a seed already."""
        return replace(self, seed=seed) if self.seed is None else self

    def generator(self, collision: Collision) -> np.random.Generator:
        """Return the random generator of a collision, seeded with J, v- and the seed of the law."""
        J: Any = collision.jacobian
        known = collision.pre_velocity + 0.0, (J.toarray() if is_sparse(J) else J) + 0.0  # + 0.0 turns -0.0 into 0.0
        digest = hashlib.sha256(b"".join(part.tobytes() for part in known)).digest()
        return np.random.default_rng([self.seed or 0, int.from_bytes(digest[:8], "little")])
