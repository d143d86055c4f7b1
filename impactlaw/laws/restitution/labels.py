"""Restitution keyed by contact labels, so that it survives a changing set of closed contacts.

A label is two names with a slash, ``"ball1/floor"``; the order of the two names does not matter.
"""

from __future__ import annotations

from impactlaw.errors import RestitutionError, UnknownNameError


def canonical(label: object) -> str:
    """Return the label with its two names sorted; takes ``"a/b"`` or ``("a", "b")``; any other string as it is.

    Raises:
        RestitutionError: neither a string nor a pair of strings.
    """
    if isinstance(label, str):
        names = label.split("/")
        return "/".join(sorted(names)) if len(names) == 2 else label
    if isinstance(label, tuple) and len(label) == 2 and all(isinstance(name, str) for name in label):
        return "/".join(sorted(label))
    raise RestitutionError(f'a contact is named "first/second" or ("first", "second"), got {label!r}')


def put(table: dict, key: object, value: float) -> None:
    """Enter a value under a canonical key.

    Raises:
        RestitutionError: the key, perhaps in another order of its names, already has a different value.
    """
    if table.setdefault(key, value) != value:
        raise RestitutionError(
            f"{key} has two restitutions, {table[key]} and {value}; the order of names does not matter"
        )


def check_labels(used: object, known: tuple[str, ...]) -> None:
    """Compare the labels that a law uses with those a scene can have.

    Raises:
        UnknownNameError: a label that no contact of the scene can have; names the nearest ones.
    """
    known_canonical = {canonical(label) for label in known}
    for label in sorted(used):  # pyright: ignore[reportArgumentType]
        if label not in known_canonical:
            raise UnknownNameError("contact", label, known)
