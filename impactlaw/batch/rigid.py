"""Worlds of a batch whose contact is rigid: time stepping in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlaw.batch.laws import Laws
from impactlaw.batch.rows import Fields
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.stepping.compiled.engine import Pool, delete_others, fill_context, when_gone
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.options import Options
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.time_stepping.compiled.borrow import room
from impactlaw.stepping.time_stepping.compiled.entry import WORLDS, many
from impactlaw.stepping.time_stepping.compiled.state import memory, status
from impactlaw.stepping.time_stepping.compiled.state.law import reason
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.surfaces import forget_surfaces
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.inertial_forces import INERTIA
from impactlaw.stepping.time_stepping.scheme import TimeStepping

_WHY = {
    status.HUGE_INPUT: "the state is not finite, or huge",
    status.HUGE_OUTPUT: "position or velocity is not finite, or huge",
    status.NOT_FINITE: "the forces are not finite",
    status.CREATES: "the law creates energy",
    status.TIMESTEP: "the timestep is not positive",
    status.OVERRIDDEN: "MuJoCo's override of contacts is on",
}
_COUNTED = slice(MEMORY.steps, MEMORY.created)  # what is counted over steps, and told of the last one
_DIVERGED = {status.HUGE_INPUT, status.HUGE_OUTPUT, status.NOT_FINITE}


class _OneRigidWorld:
    """One world of time stepping, as `laws.OneWorld`."""

    restitution_at = SETTING.restitution

    def __init__(self, scheme: TimeStepping):
        self.scheme, self.set_law, self.coefficients = scheme, scheme.set_law, scheme.coefficients

    def reason(self) -> str | None:
        """Return why compiled code does not take the law; None if it does."""
        return reason(self.scheme)

    def settings(self) -> Sequence[float]:
        """Return the scheme's, but forces are not written as MuJoCo's own cones have them."""
        row = list(self.scheme.settings())
        row[SETTING.forces] = 0.0
        return row


class RigidWorlds:
    """What time stepping needs of many worlds.

    Attributes:
        address: of the entry.
        context: what the entry is given, see `compiled.entry.Worlds`.
        places: see there.
        laws: of the worlds.
    """

    address, places = many.address, WORLDS

    def __init__(self, model: Any, plan: Plan, law: Law, options: Options, pool: Pool, fields: Fields):
        friction, inadmissible = options.friction or "coulomb", options.on_inadmissible or "project"
        scheme = TimeStepping(
            model, law, plan, friction=friction, on_inadmissible=inadmissible, rest_speed=options.rest_speed
        )
        self._model, self._scheme, worlds = model, scheme, pool.worlds
        self.laws = Laws(_OneRigidWorld(scheme), worlds, len(SETTING))
        self._memory = memory.make_memory(model, worlds)
        self._counted = self._memory[:, _COUNTED].copy()
        self._report = np.zeros((worlds, 2), np.int64)
        self._carriers, self._bilateral = scheme.carriers, constraint_kinds(scheme.model)
        self._slots, self._table = np.zeros((pool.threads + 1, 2), np.int64), table()
        when_gone(self, _free, self._memory, self._slots)
        self.context = np.zeros(len(WORLDS), np.int64)
        arrays = {
            "table": self._table, "carriers": self._carriers, "bilateral": self._bilateral, "slots": self._slots,
            "settings_of": self.laws.settings, "laws_of": self.laws.places, "memory_of": self._memory,
            "status_of": self._report,
        }  # fmt: skip
        numbers = {
            "margin_count": room(model), "states": fields.state.shape[1], "memories": self._memory.shape[1],
            "slot_count": len(self._slots),
        }  # fmt: skip
        fill_context(self.context, WORLDS, arrays, numbers)

    @property
    def impact_count(self) -> np.ndarray:
        """Steps of each world so far in which something collided, (nsim,)."""
        return self._memory[:, MEMORY.impacts].astype(int)

    @property
    def inadmissible_count(self) -> np.ndarray:
        """Of these, steps in which an outcome by the law left S(v-), (nsim,)."""
        return self._memory[:, MEMORY.inadmissible].astype(int)

    @property
    def short_steps(self) -> np.ndarray:
        """Steps of each world so far that did not meet their law, (nsim,)."""
        return self._memory[:, MEMORY.short_steps].astype(int)

    @property
    def shortfall(self) -> np.ndarray:
        """Largest amount by which each world has missed its law so far, m/s or rad/s, (nsim,)."""
        return self._memory[:, MEMORY.worst].copy()

    def expand(self, name: str) -> None:
        """Have a field of the model differ between worlds: Coriolis and gyroscopic forces are looked for in all."""
        if name in INERTIA:
            self._scheme.inertial.act = True
            self.laws.settings[:, SETTING.inertial] = 1.0

    def start(self, worlds: np.ndarray, steps: int) -> None:
        """Let the next call take so many steps of some worlds."""
        self.context[WORLDS.steps] = steps
        self._report[worlds, 0] = status.FINE
        self._counted = self._memory[:, _COUNTED].copy()

    def go_on(self, worlds: np.ndarray) -> np.ndarray:
        """Do what compiled code has left, and return the worlds that are to be stepped once more, int32 (k,)."""
        asked = worlds[self._report[worlds, 0] == status.UNKNOWN]
        for world in asked.tolist():
            self.laws.learn(world, int(self._report[world, 1]))
        self._report[asked, 0] = status.FINE
        return asked

    def failed(self, worlds: np.ndarray) -> dict[int, tuple[str, bool]]:
        """Return worlds whose steps have failed, why, and whether they have left the finite numbers."""
        how = self._report[worlds, 0]
        found = zip(worlds[how != status.FINE].tolist(), how[how != status.FINE].tolist(), strict=True)
        return {world: (_WHY[one], one in _DIVERGED) for world, one in found}

    def put_back(self, worlds: np.ndarray) -> None:
        """Let worlds that an error of MuJoCo's engine has ended be as they were before the call."""
        self._memory.view(np.int64)[worlds, MEMORY.known] = 0
        self._memory[worlds, _COUNTED] = self._counted[worlds]
        forget_surfaces(self._memory, worlds, self._model)

    def begin(self, worlds: np.ndarray) -> None:
        """Let worlds have nothing to remember."""
        memory.begin(self._memory, worlds, self._model)


def _free(numbers: np.ndarray, slots: np.ndarray) -> None:
    """Give back what the worlds remember, and the other data of each thread."""
    memory.free(numbers)
    delete_others(slots)
