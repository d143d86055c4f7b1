"""Step the worlds of a batch with rigid contact: time stepping in compiled code."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from impactlaw.batch.laws import Converted, Count, Laws, check_covered
from impactlaw.batch.rows import Fields
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.stepping.compiled.engine import Pool, delete_others, fill_context, when_gone
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.integration import STEP_STATE, empty_state
from impactlaw.stepping.options import Options
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.time_stepping.compiled.entry import WORLDS, many
from impactlaw.stepping.time_stepping.compiled.model_copy import room
from impactlaw.stepping.time_stepping.compiled.state import memory, status
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.surfaces import forget_surfaces
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.inertial_forces import INERTIA
from impactlaw.stepping.time_stepping.law_in_scene import LawInScene

_WHY = {
    status.HUGE_INPUT: "the state is not finite, or huge",
    status.HUGE_OUTPUT: "position or velocity is not finite, or huge",
    status.NOT_FINITE: "the forces are not finite",
    status.CREATES: "the law creates energy",
    status.TIMESTEP: "the timestep is not positive",
    status.OVERRIDDEN: "MuJoCo's override of contacts is on",
}
_COUNTED = slice(MEMORY.steps, MEMORY.created)  # counts over all steps, and results of the last step
_DIVERGED = {status.HUGE_INPUT, status.HUGE_OUTPUT, status.NOT_FINITE}


class RigidWorlds:
    """The worlds of a time-stepped batch: their laws, memory and reports, as compiled code reads and writes them.

    Attributes:
        address: address of the compiled function that steps one world.
        context: the argument of that function: addresses and sizes of its arrays, int64.
        places: names of the entries of `context`, see `compiled.entry.Worlds`.
        laws: the laws of the worlds.
    """

    address, places = many.address, WORLDS

    def __init__(self, model: Any, plan: Plan, law: Law, options: Options, pool: Pool, fields: Fields):
        friction, inadmissible = options.friction or "coulomb", options.on_inadmissible or "project"
        scene = LawInScene(
            model, law, plan, friction=friction, on_inadmissible=inadmissible, rest_speed=options.rest_speed
        )
        self._model, self._scene, worlds = model, scene, pool.worlds
        self.laws = Laws(partial(_convert, scene), worlds, len(SETTING), SETTING.restitution)
        self._memory = memory.make_memory(model, worlds)
        self._counted = self._memory[:, _COUNTED].copy()
        self._report = np.zeros((worlds, 2), np.int64)
        self._carriers, self._bilateral = scene.carriers, constraint_kinds(model)
        self._slots, self._table = np.zeros((pool.threads + 1, 2), np.int64), table()
        when_gone(self, _free, self._memory, self._slots)
        self.context = np.zeros(len(WORLDS), np.int64)
        arrays = {
            "table": self._table, "carriers": self._carriers, "bilateral": self._bilateral, "slots": self._slots,
            "settings_of": self.laws.settings, "laws_of": self.laws.places, "memory_of": self._memory,
            "status_of": self._report,
        }  # fmt: skip
        numbers = {
            "margin_count": room(model), "states": len(empty_state(model, STEP_STATE)),
            "memories": self._memory.shape[1], "slot_count": len(self._slots),
        }  # fmt: skip
        fill_context(self.context, WORLDS, arrays, numbers)

    def count(self, name: Count) -> np.ndarray:
        """Return the number of steps of each world so far with a collision, an inadmissible one, or that were short."""
        return self._memory[:, getattr(MEMORY, name)].astype(int)

    @property
    def shortfall(self) -> np.ndarray:
        """Largest amount by which a normal velocity of each world has missed the law so far, m/s or rad/s, (nsim,)."""
        return self._memory[:, MEMORY.worst].copy()

    def expand(self, name: str) -> None:
        """Prepare for a field of the model that differs between worlds.

        If inertial forces depend on the field, Coriolis and gyroscopic forces are computed in all worlds from now on.
        """
        if name in INERTIA:
            self._scene.inertial.act = True
            self.laws.settings[:, SETTING.inertial] = 1.0

    def start(self, worlds: np.ndarray, steps: int) -> None:
        """Prepare a call that takes a number of steps in some worlds."""
        self.context[WORLDS.steps] = steps
        self._report[worlds, 0] = status.FINE
        self._counted = self._memory[:, _COUNTED].copy()

    def go_on(self, worlds: np.ndarray) -> np.ndarray:
        """Look up the coefficients that compiled code lacked; return the worlds to be stepped again, int32 (k,)."""
        asked = worlds[self._report[worlds, 0] == status.UNKNOWN]
        for world in asked.tolist():
            self.laws.learn(world, int(self._report[world, 1]))
        self._report[asked, 0] = status.FINE
        return asked

    def failed(self, worlds: np.ndarray) -> dict[int, tuple[str, bool]]:
        """Return the worlds whose steps failed, each with the reason and whether its state diverged."""
        how = self._report[worlds, 0]
        found = zip(worlds[how != status.FINE].tolist(), how[how != status.FINE].tolist(), strict=True)
        return {world: (_WHY[one], one in _DIVERGED) for world, one in found}

    def put_back(self, worlds: np.ndarray) -> None:
        """Restore the counts of worlds whose call ended in an error of MuJoCo, and forget their last step."""
        self._memory.view(np.int64)[worlds, MEMORY.known] = 0
        self._memory[worlds, _COUNTED] = self._counted[worlds]
        forget_surfaces(self._memory, worlds, self._model)

    def begin(self, worlds: np.ndarray) -> None:
        """Clear the memory of worlds: their counts and their last step."""
        memory.begin(self._memory, worlds, self._model)


def _convert(scene: LawInScene, law: Law) -> Converted:
    """Convert a law for compiled code; forces are not written in the form of MuJoCo's cones."""
    scene = scene.under(law)
    check_covered(scene.reason)
    row = list(scene.settings())
    row[SETTING.forces] = 0.0
    return scene.coefficients(), row


def _free(numbers: np.ndarray, slots: np.ndarray) -> None:
    """Free the memory of the worlds, and the second data of each thread."""
    memory.free(numbers)
    delete_others(slots)
