"""Seeds of laws that draw their outcomes, one for each episode."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class EpisodeSeeds:
    """Draws from a generator of its own, so that an environment starts its episodes as it does under other laws.

    Args:
        stream: tells those apart that are seeded with the same number.
    """

    def __init__(self, stream: int):
        self._stream = stream
        self.generator = np.random.default_rng()

    def begin(self, seed: int | None) -> None:
        """Begin anew where a reset has a seed."""
        if seed is not None:
            self.generator = np.random.default_rng([seed, self._stream])

    @contextmanager
    def begun(self, seed: int | None) -> Iterator[None]:
        """Begin, for a context; if that fails, the generator is as it was before."""
        before, state = self.generator, self.generator.bit_generator.state
        try:
            self.begin(seed)
            yield
        except BaseException:
            self.generator, before.bit_generator.state = before, state
            raise

    def draw(self) -> int:
        """Return a seed."""
        return int(self.generator.integers(2**31))


OUTCOMES, LAWS = 1, 2
"""Streams: of outcomes of a law, and of the law itself."""
