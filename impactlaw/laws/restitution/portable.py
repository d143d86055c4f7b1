"""Conversion of laws to plain values, such as JSON has, and back, for files and other processes."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from impactlaw.errors import ImpactLawError, RestitutionError
from impactlaw.laws.base import Law

_LAW, _FUNCTION, _ENTRIES = "law class", "function", "entries"


def portable(value: Any) -> Any:
    """Return a law, or an argument of a law, as numbers, strings, lists and dictionaries; `restored` is the inverse.

    Raises:
        RestitutionError: it contains an object that cannot be imported by name, such as a lambda or a local class.
    """
    if isinstance(value, Law):
        parts = {part.name: portable(getattr(value, part.name)) for part in dataclasses.fields(value) if part.init}
        return {_LAW: _place(type(value)), **parts}
    if isinstance(value, Mapping):
        return {_ENTRIES: [[portable(key), portable(entry)] for key, entry in value.items()]}
    if isinstance(value, list | tuple):
        return [portable(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if callable(value):
        return {_FUNCTION: _place(value)}
    if value is None or isinstance(value, str | float | int):
        return value
    if callable(getattr(value, "toarray", None)):  # scipy's sparse arrays
        return value.toarray().tolist()
    raise RestitutionError(f"{value!r} cannot be written down as plain values")


def restored(value: Any) -> Any:
    """Return the law, or argument of a law, of which `portable` made this value; return any other value unchanged.

    Raises:
        RestitutionError: it names a law or function that does not exist, or the fields are not those of the law.
    """
    if not isinstance(value, Mapping):
        return value
    try:
        return _made(value)
    except (TypeError, ValueError) as error:
        if isinstance(error, ImpactLawError):
            raise
        raise RestitutionError(f"{dict(value)!r:.100} is no law that was written down: {error}") from None


def _made(value: Mapping[str, Any]) -> Any:
    if _LAW in value:
        kind = _found(value[_LAW])
        if not (isinstance(kind, type) and issubclass(kind, Law)):
            raise RestitutionError(f"{value[_LAW]} is no impact law")
        given = {name: _listed(entry) for name, entry in value.items() if name != _LAW}
        known = {part.name for part in dataclasses.fields(kind) if part.init}
        if not given.keys() <= known:
            raise RestitutionError(f"{value[_LAW]} has no {', '.join(sorted(given.keys() - known))}")
        return kind(**given)
    if _FUNCTION in value:
        return _found(value[_FUNCTION])
    if _ENTRIES in value:
        return {_key(key): restored(entry) for key, entry in value[_ENTRIES]}
    return value


def _listed(value: Any) -> Any:
    return [_listed(entry) for entry in value] if isinstance(value, list) else restored(value)


def _key(value: Any) -> Any:
    return tuple(map(_key, value)) if isinstance(value, list) else value


def _place(value: Any) -> str:
    """Return ``module:name`` of a class or function; raise `RestitutionError` if it cannot be found by that."""
    place = f"{getattr(value, '__module__', None)}:{getattr(value, '__qualname__', None)}"
    module = sys.modules.get(getattr(value, "__module__", None) or "")
    if getattr(module, getattr(value, "__qualname__", ""), None) is not value:
        raise RestitutionError(f"{place} cannot be written down: it is not at the top of a module")
    return place


def _found(place: str) -> Any:
    module, _, name = str(place).partition(":")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, TypeError, ValueError):
        raise RestitutionError(f"there is no {place} here") from None
