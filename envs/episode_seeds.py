"""Seeds, one per episode, for laws that draw their outcomes."""

from __future__ import annotations

import numbers
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from impactlaw.errors import OptionError


class EpisodeSeeds:
    """A source of seeds with its own generator, so that episodes start in the same way under every law.

    Args:
        stream: number that separates sources seeded with the same seed.
    """

    def __init__(self, stream: int):
        self._stream = stream
        self.generator = np.random.default_rng()

    def begin(self, seed: int | None) -> None:
        """Reseed the generator if a reset has a seed.

        Raises:
            OptionError: the seed is not a nonnegative integer.
        """
        if seed is None:
            return
        if not isinstance(seed, numbers.Integral) or seed < 0:
            raise OptionError(f"a seed is a whole number, 0 or more, got {seed!r:.100}")
        self.generator = np.random.default_rng([int(seed), self._stream])

    @contextmanager
    def begun(self, seed: int | None) -> Iterator[None]:
        """Reseed the generator for a context; if the context raises, restore the generator."""
        before, state = self.generator, self.generator.bit_generator.state
        try:
            self.begin(seed)
            yield
        except BaseException:
            self.generator, before.bit_generator.state = before, state
            raise

    def draw(self) -> int | None:
        """Draw a seed; None where environments have no seeds, so that a law keeps its own, 0 if it has none."""
        return int(self.generator.integers(2**31))


class NoSeeds(EpisodeSeeds):
    """No seeds, for environments whose resets have none."""

    def draw(self) -> int | None:
        """Return None."""
        return None


OUTCOMES, LAWS = 1, 2
"""Streams: one for outcomes drawn by a law, one for drawing the law itself."""
