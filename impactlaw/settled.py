"""Attributes that are settled when their owner is made."""

from __future__ import annotations

from typing import Any

from impactlaw.errors import SettledError


class Settled:
    """An attribute that can be read, and set once: a later change would have no effect, so it is an error.

    Args:
        instead: what to do for another value.
    """

    def __init__(self, instead: str):
        self._instead = instead
        self._name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        if self._name not in instance.__dict__:
            raise AttributeError(f"{type(instance).__name__} has no {self._name} yet")
        return instance.__dict__[self._name]

    def __set__(self, instance: Any, value: Any) -> None:
        """Set it.

        Raises:
            SettledError: it has been set before.
        """
        if self._name in instance.__dict__:
            raise SettledError(
                f"{self._name} of {type(instance).__name__} is settled when it is made, and cannot be set to {value!r} "
                f"later; {self._instead}"
            )
        instance.__dict__[self._name] = value
