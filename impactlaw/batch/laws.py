"""The laws of many worlds, in the form that compiled code reads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from impactlaw.errors import RestitutionError, SceneError
from impactlaw.laws import Law
from impactlaw.stepping.compiled.law_table import Coefficients

Count = Literal["impacts", "inadmissible", "short_steps"]
Converted = tuple[Coefficients, Sequence[float]]
"""A law for compiled code: an empty table of its coefficients; the options, and the values common to all contacts."""


def check_covered(why: str | None) -> None:
    """Raise SceneError if there is a reason why compiled code does not cover a law."""
    if why is not None:
        raise SceneError(
            f"a batch cannot be under this law: {why}, so that it must be asked in Python at each collision; use a "
            "Stepper for each world, or a law with one number per contact, such as Moreau(0.5) or Newton({...})"
        )


class Laws:
    """One law per world.

    Args:
        convert: converts a law, and raises SceneError if compiled code does not cover it.
        worlds: number of worlds.
        settings: number of options and common values.
        restitution_at: index of e among them.

    Attributes:
        settings: options and common values of each world, (nsim, n).
        restitution: e of each world, (nsim,), NaN where a law has several coefficients; a view of the settings.
        places: address of keys, address of values and number of entries of each table of coefficients, int64 (nsim, 3).
        given: the law last given to each world.
    """

    def __init__(self, convert: Callable[[Law], Converted], worlds: int, settings: int, restitution_at: int):
        self._convert, self._restitution_at = convert, restitution_at
        self.settings = np.zeros((worlds, settings))
        self.restitution = self.settings[:, restitution_at]
        self.places = np.zeros((worlds, 3), np.int64)
        self.given: list[Any] = [None] * worlds
        self._by_contact = np.zeros(worlds, dtype=bool)
        self._tables: list[Coefficients | None] = [None] * worlds

    def set(self, laws: Sequence[Law], worlds: Sequence[int]) -> None:
        """Give each of some worlds its law; if one law is refused, change no world."""
        made = {key: self._convert(law) for key, law in {id(law): law for law in laws}.items()}
        for world, law in zip(worlds, laws, strict=True):
            table, row = made[id(law)]
            self._by_contact[world] = np.isnan(row[self._restitution_at])
            self.settings[world], self._tables[world], self.given[world] = row, table, law
            self._place(world)

    def check(self) -> None:
        """Raise RestitutionError if a value written to `restitution` is not in [0, 1]."""
        e = self.restitution
        fine = (e >= 0.0) & (e <= 1.0) | self._by_contact & np.isnan(e)
        if not fine.all():
            world = int(np.flatnonzero(~fine)[0])
            raise RestitutionError(f"restitution of world {world} must be in [0, 1], got {e[world]:g}")

    def learn(self, world: int, key: int) -> None:
        """Add the restitution of a contact, by its key, to the table of a world's law."""
        table = self._tables[world]
        assert table is not None
        table.learn(key)
        for other, held in enumerate(self._tables):
            if held is table:
                self._place(other)

    def _place(self, world: int) -> None:
        table = self._tables[world]
        assert table is not None
        self.places[world] = table.key.ctypes.data, table.value.ctypes.data, len(table.key)
