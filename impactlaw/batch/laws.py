"""The laws of many worlds as compiled code takes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlaw.errors import RestitutionError, SceneError
from impactlaw.laws import Law
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.time_stepping.compiled.state.law import reason
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.scheme import TimeStepping


class Laws:
    """A law for each world.

    Args:
        scheme: the scheme of one world; laws are tried on it.
        worlds: how many.

    Attributes:
        settings: see `world.Settings`, (nsim, n).
        places: address of keys, address of values, and how many, int64 (nsim, 3).
    """

    def __init__(self, scheme: TimeStepping, worlds: int):
        self._scheme = scheme
        self.settings = np.zeros((worlds, len(SETTING)))
        self.places = np.zeros((worlds, 3), np.int64)
        self._by_contact = np.zeros(worlds, dtype=bool)
        self._tables: list[Coefficients | None] = [None] * worlds
        self._made: dict[int, tuple[Law, Coefficients]] = {}

    def set(self, law: Law, worlds: Sequence[int]) -> None:
        """Give a law to some worlds.

        Raises:
            SceneError: compiled code does not take it.
        """
        self._scheme.set_law(law)
        why = reason(self._scheme)
        if why is not None:
            raise SceneError(f"a batch cannot be under this law: {why}; use Stepper, or another law")
        table = self._scheme.coefficients()
        row = self._scheme.settings()
        self._by_contact[list(worlds)] = np.isnan(row[SETTING.restitution])
        for world in worlds:
            self.settings[world], self._tables[world] = row, table
            self.settings[world, SETTING.forces] = 0.0
            self._place(world)

    def check(self) -> None:
        """Refuse restitution that was written and is none.

        Raises:
            RestitutionError: one is not in [0, 1]; or it is NaN, and the law has one for all contacts.
        """
        e = self.settings[:, SETTING.restitution]
        fine = (e >= 0.0) & (e <= 1.0) | self._by_contact & np.isnan(e)
        if not fine.all():
            world = int(np.flatnonzero(~fine)[0])
            raise RestitutionError(f"restitution of world {world} must be in [0, 1], got {e[world]:g}")

    def see_inertial_forces(self) -> None:
        """Let Coriolis and gyroscopic forces be looked for in all worlds, whatever the model is."""
        self._scheme.inertial.act = True
        self.settings[:, SETTING.inertial] = 1.0

    def learn(self, world: int, key: int) -> None:
        """Ask the law of a world for the restitution of a contact.

        Raises:
            RestitutionError: the law does not know it.
        """
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
