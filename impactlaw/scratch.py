"""Data of a scene that computations write to, beside the data of the user."""

from __future__ import annotations

from functools import cached_property

import mujoco


class Scratch:
    """Other data of a scene, made when it is first used; a copy makes its own.

    MuJoCo's pickles of `MjData` keep the addresses of its plugins, so that the original and its copy would share them,
    and free them twice.

    Args:
        model: the scene.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model

    @cached_property
    def data(self) -> mujoco.MjData:
        """The data; what it contains is left from its last use."""
        return mujoco.MjData(self._model)

    def __reduce__(self) -> tuple[type[Scratch], tuple[mujoco.MjModel]]:
        """Return how a copy is made: with data of its own."""
        return Scratch, (self._model,)
