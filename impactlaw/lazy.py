"""Attributes that are computed when first asked for: `functools.cached_property` without the lock of Python 3.11.

That lock costs as much as an operation on a small array, and a law asks for half a dozen such attributes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property:  # noqa: N801
        """A method whose value becomes an attribute of the instance; two threads may both compute it."""

        def __init__(self, compute: Any):
            self.compute, self.__doc__ = compute, compute.__doc__

        def __set_name__(self, owner: type, name: str):
            self.name = name

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            if instance is None:
                return self
            instance.__dict__[self.name] = value = self.compute(instance)
            return value


__all__ = ["cached_property"]
