"""Values such as restitution keyed by contact labels, which remain valid while the set of closed contacts changes.

A label is two geom names with a slash between them, ``"ball1/floor"``, in either order; a limit has the name of its
joint or tendon. The README of the laws explains patterns such as ``"*foot*/floor"``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError, UnknownNameError


def canonical(label: object) -> str:
    """Return a label, ``"a/b"`` or ``("a", "b")``, with its two names in a unique order.

    If names contain slashes themselves, it is not known which slash separates them. The result is then the first in
    alphabetical order of the label and all labels made by swapping its parts at one slash. Patterns with more than one
    slash stay unchanged.
    """
    if isinstance(label, tuple) and len(label) == 2 and all(isinstance(name, str) for name in label):
        label = "/".join(label)
    if isinstance(label, str):
        if label.count("/") > 1 and is_pattern(label):
            return label
        return min(_forms(label))
    raise RestitutionError(f'a contact is named "first/second" or ("first", "second"), got {label!r}')


def put(table: dict, key: object, value: float) -> None:
    """Enter a value under a canonical key; refuse a different value for a key that is already there."""
    if table.setdefault(key, value) != value:
        raise RestitutionError(
            f"{key} has two restitutions, {table[key]} and {value}; the order of names does not matter"
        )


def checked_values(value: Any, name: str, check: Callable[[Any, str], Any], law: str) -> Any:
    """Check the values of a law for its contacts; return one for all, a tuple, or a dict keyed by canonical labels.

    ``check(value, name)`` returns the value of one contact, or raises; ``name`` and ``law`` are for messages.
    """
    if isinstance(value, Mapping):
        table: dict[str, Any] = {}
        for key, one in value.items():
            put(table, canonical(key), check(one, f"{name} of {canonical(key)}"))
        return table
    if isinstance(value, Set):
        raise RestitutionError(f"{law} takes one {name} for each contact in order, but a set has none: {value!r}")
    if callable(value) or isinstance(value, str | bytes) or not np.iterable(value):
        return check(value, name)
    return tuple(check(one, f"{name} of contact {i}") for i, one in enumerate(value))


def is_pattern(key: str) -> bool:
    """Return whether a key is a pattern: whether it contains ``*``, ``?`` or ``[``."""
    return any(character in key for character in "*?[")


def matches(pattern: str, label: str) -> bool:
    """Return whether a pattern matches this contact or limit, for any way to split labels with several slashes."""
    pairs, wanted = tuple(_pairs(label)), tuple(_pairs(pattern))
    if fnmatchcase(label, pattern) or any(fnmatchcase(name, pattern) for pair in pairs for name in pair):
        return True
    return any(fnmatchcase(a, p) and fnmatchcase(b, q) for p, q in wanted for c in pairs for a, b in (c, c[::-1]))


class OfContacts:
    """A law with a value for each contact: one for all, a tuple in their order, or a dict by labels and patterns.

    The values have passed `checked_values` and are in the field whose name is ``_name``.
    """

    _name = "restitution"
    default = None

    @property
    def _values(self) -> Any:
        return getattr(self, self._name)

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels and patterns by which the law is keyed, in canonical form; empty if it has no keys."""
        return frozenset(self._values) if isinstance(self._values, dict) else frozenset()

    @property
    def contact_count(self) -> int | None:
        """Number of contacts that the law fits; None if it fits any number."""
        return len(self._values) if isinstance(self._values, tuple) else None

    @cached_property
    def patterns(self) -> tuple[str, ...]:
        """The keys that are patterns."""
        return tuple(filter(is_pattern, self._values)) if isinstance(self._values, dict) else ()

    def _of_contacts(self, labels: tuple[str, ...], what: str) -> list[Any]:
        """Return the value of each contact, or None where a contact has no value."""
        values = self._values
        if isinstance(values, dict):
            return [self.named(label) for label in labels]
        if isinstance(values, tuple) and len(values) != len(labels):
            raise RestitutionError(
                f"{type(self).__name__} has {len(values)} {what} but {len(labels)} contacts collide "
                f"({', '.join(labels)}); key them by contact label so that they follow the contacts, or give one for "
                "all (a stepper goes on from before this step once its law is set)"
            )
        return list(values) if isinstance(values, tuple) else [values] * len(labels)

    def named(self, label: str) -> Any:
        """Return the value of a contact of a law keyed by labels; for one that is not named the default, or None."""
        table = self._values
        found = table.get(canonical(label))
        if found is None and is_pattern(label):  # geom names may contain the characters of patterns
            found = next((table[form] for form in _forms(label) if form in table), None)
        if found is not None or not self.patterns:
            return self.default if found is None else found
        fitting = [key for key in self.patterns if matches(key, label)]
        for key in fitting[1:]:
            if table[key] != table[fitting[0]]:
                raise RestitutionError(
                    f"contact {label} matches {fitting[0]!r} and {key!r}, which have different values: "
                    f"{table[fitting[0]]} and {table[key]}; key it by its own name, or make the patterns narrower"
                )
        return table[fitting[0]] if fitting else self.default


def check_labels(used: Iterable[str], known: tuple[str, ...], *, patterns: bool = True) -> None:
    """Check that each label a law uses, or pattern if it allows these, fits a contact that the scene can have.

    Raises:
        UnknownNameError: no contact of the scene can have this label or match this pattern; the message suggests the
            nearest labels.
    """
    exact = {canonical(label) for label in known}
    exact |= {form for label in known if is_pattern(label) for form in _forms(label)}
    for label in sorted(used):
        a_pattern = patterns and is_pattern(label)
        if label not in exact and not (a_pattern and any(matches(label, one) for one in known)):
            raise UnknownNameError("contact pattern" if a_pattern else "contact", label, known)


def _forms(label: str) -> Iterator[str]:
    """Yield all labels of the same contact: the label itself, and those with its parts swapped at one slash."""
    yield label
    for first, second in _pairs(label):
        yield f"{second}/{first}"


def _pairs(label: str) -> Iterator[tuple[str, str]]:
    """Yield the two names that a label consists of, for each slash at which it can be split."""
    parts = label.split("/")
    for cut in range(1, len(parts)):
        yield "/".join(parts[:cut]), "/".join(parts[cut:])
