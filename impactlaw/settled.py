"""Attributes that are fixed when their owner is constructed."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from impactlaw.errors import SettledError


class Settled(property):
    """An attribute that can be set only once: a later change would have no effect, so it raises `SettledError`.

    Reading is as fast as a `property` whose getter is not a Python function.
    """

    def __init__(self, instead: str, name: str = ""):
        super().__init__(attrgetter(f"_settled_{name}"))
        self.__doc__ = f"As it was when this was made; for another one, {instead}."
        self._instead = instead
        self._name = name

    def __set_name__(self, owner: type, name: str) -> None:
        self.__init__(self._instead, name)

    def __set__(self, instance: Any, value: Any) -> None:
        """Set the attribute; setting the same array again is allowed, as after ``*=``, which writes in place."""
        place = f"_settled_{self._name}"
        if hasattr(instance, place):
            if isinstance(value, np.ndarray) and value is getattr(instance, place):
                return
            raise SettledError(
                f"{self._name} of {type(instance).__name__} is settled when it is made, and cannot be set to {value!r} "
                f"later; {self._instead}"
            )
        setattr(instance, place, value)


def places(*names: str) -> tuple[str, ...]:
    """Return the slot names of settled attributes, for classes with ``__slots__``, which reject all other names."""
    return tuple(f"_settled_{name}" for name in names)
