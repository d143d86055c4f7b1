"""Worlds shared by tests of laws and of wrong arguments."""

import gymnasium
import pytest

import impactlaw.envs  # noqa: F401  (registers the environments)


@pytest.fixture
def vec():
    """Three jugglers."""
    made = gymnasium.make_vec("impactlaw/Juggler-v0", 3, vectorization_mode="vector_entry_point", nthread=1)
    yield made
    made.close()
