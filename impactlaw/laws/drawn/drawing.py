"""Laws that draw their outcomes: from a seed and the collision itself, so that a run repeats."""

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
    """A law that draws each outcome from its seed and the collision's own numbers.

    The same collision has the same outcome, in every process, and a run can be repeated. Laws declare the seed as their
    last field: a field of this class would come before theirs.

    Attributes:
        seed: 0 or more. None is 0, but environments then draw another one for each episode.

    Raises:
        RestitutionError: the seed is no whole number of 0 or more.
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
        """Return the law with this seed, if it has none of its own."""
        return replace(self, seed=seed) if self.seed is None else self

    def generator(self, collision: Collision) -> np.random.Generator:
        """Return the generator that belongs to a collision: J, v- and the law's seed are its seed."""
        J: Any = collision.jacobian
        known = collision.pre_velocity + 0.0, (J.toarray() if is_sparse(J) else J) + 0.0  # of which no zero has a sign
        digest = hashlib.sha256(b"".join(part.tobytes() for part in known)).digest()
        return np.random.default_rng([self.seed or 0, int.from_bytes(digest[:8], "little")])
