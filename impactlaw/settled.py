"""Attributes that are settled when their owner is made."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from impactlaw.errors import SettledError


class Settled(property):
    """An attribute that can be read, and set once: a later change would have no effect, so it is an error.

    It is read at the price of a `property` that calls no Python.
    """

    def __init__(self, instead: str, name: str = ""):
        super().__init__(attrgetter(f"_settled_{name}"))
        self.__doc__ = f"As it was when this was made; for another one, {instead}."
        self._instead = instead
        self._name = name

    def __set_name__(self, owner: type, name: str) -> None:
        self.__init__(self._instead, name)

    def __set__(self, instance: Any, value: Any) -> None:
        """Set it; an array that was written in place, as by ``*=``, is the same one."""
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
    """Return the slots of settled attributes, for a class without a ``__dict__``: other names are errors there."""
    return tuple(f"_settled_{name}" for name in names)
