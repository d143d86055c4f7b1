"""Step the worlds of a batch with soft contact: in compiled code, and a few steps in Python."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import partial
from typing import Any, get_args

import mujoco
import numpy as np

from impactlaw.batch.laws import Converted, Count, Laws, check_covered
from impactlaw.batch.rows import Fields
from impactlaw.errors import DivergenceError, ImpactLawError, SceneError
from impactlaw.laws import Coulomb, Law, Moreau
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.solvers import load_solvers
from impactlaw.stepping.compiled.engine import Pool, delete_others, fill_context, when_gone
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.impact_event import sums_of
from impactlaw.stepping.integration import restore_state, save_state
from impactlaw.stepping.options import Options
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.soft.compiled.batch_entry import WORLDS, many
from impactlaw.stepping.soft.compiled.law import coefficients, reason, settings
from impactlaw.stepping.soft.compiled.world import DIVERGED, FINE, PYTHON, SETTING, UNKNOWN
from impactlaw.stepping.soft.scheme import SoftStepping
from impactlaw.stepping.way import Way

_DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)
_HOW, _ASKED, _TAKEN = 0, 1, 2  # columns of the report: how the call ended, key asked for, steps taken
_COUNTS = get_args(Count)  # columns of the counts of a world
_FAILED = -1  # a step in Python has failed: the world is not stepped again in this call
_HUGE = "MuJoCo met a state that is not finite, or huge"


class SoftWorlds:
    """The worlds of a batch with soft contact; arguments and attributes are those of `rigid.RigidWorlds`."""

    address, places = many.address, WORLDS

    def __init__(self, model: Any, plan: Plan, law: Law, options: Options, pool: Pool, fields: Fields):
        load_solvers()
        self._model, self._plan, self._options, self._pool, self._fields = model, plan, options, pool, fields
        self._way = Way(model, plan, options, None)
        self._scheme = scheme = _stepping(self._way, law)
        worlds = pool.worlds
        why = scheme.only_in_python
        if scheme.collisions.surfaces is not None:
            why = "mocap bodies that touch others move as surfaces, or belts run"
        if why is None and model.opt.integrator == _DISCRETE:
            why = 'its integrator is "discrete"'
        if why is not None:
            raise SceneError(f"a batch takes no soft steps of this scene: {why}; use Stepper")
        self.laws = Laws(partial(_convert, self._way, scheme), worlds, len(SETTING), SETTING.restitution)
        self._data, self._expanded = mujoco.MjData(model), False
        self._memory, self._report = np.zeros((worlds, 3)), np.zeros((worlds, 3), np.int64)
        self._failed: dict[int, tuple[str, bool]] = {}
        self._counted = self._memory.copy()
        self._first, self._table = np.zeros_like(fields.state), table()
        self._bilateral = constraint_kinds(model) if scheme.collisions.bilateral.any() else np.zeros(0, np.uint8)
        self._slots = np.zeros((pool.threads + 1, 2), np.int64)
        when_gone(self, delete_others, self._slots)
        self.context = np.zeros(len(WORLDS), np.int64)
        arrays = {
            "table": self._table, "bilateral": self._bilateral, "slots": self._slots, "laws_of": self.laws.places,
            "settings_of": self.laws.settings, "states_of": self._first, "memory_of": self._memory,
            "status_of": self._report,
        }  # fmt: skip
        numbers = {
            "constraints": len(self._bilateral), "frictional": scheme.collisions.friction,
            "collides": scheme.collides, "states": self._first.shape[1], "slot_count": len(self._slots),
        }  # fmt: skip
        fill_context(self.context, WORLDS, arrays, numbers)

    def count(self, name: Count) -> np.ndarray:
        """Return a count, see `rigid.RigidWorlds`; short steps lost restitution, or were left to MuJoCo's contacts."""
        return self._memory[:, _COUNTS.index(name)].astype(int)

    @property
    def shortfall(self) -> np.ndarray:
        """Zeros, (nsim,): every collision is certified or counted in `short_steps`."""
        return np.zeros(len(self._report))

    def expand(self, name: str) -> None:
        """Prepare for a field of the model that differs between worlds: steps in Python read each world's own model."""
        self._expanded = True

    def start(self, worlds: np.ndarray, steps: int) -> None:
        """Prepare a call that takes a number of steps in some worlds."""
        self.context[WORLDS.steps] = steps
        self._report[worlds] = FINE, 0, 0
        self._failed, self._counted = {}, self._memory.copy()

    def go_on(self, worlds: np.ndarray) -> np.ndarray:
        """Look up coefficients and take the steps that compiled code left to Python; return the worlds to go on with.

        These are the worlds that have not taken all steps of the call yet, int32 (k,).
        """
        how = self._report[worlds, _HOW]
        diverged = worlds[how == DIVERGED]
        self._memory[diverged] = self._counted[diverged]
        left, python = worlds[how == UNKNOWN], worlds[how == PYTHON]
        try:
            for world in left.tolist():
                self.laws.learn(world, int(self._report[world, _ASKED]))
        except ImpactLawError:
            self.put_back(np.concatenate([left, python]))
            raise
        for world in python.tolist():
            self._step_in_python(world)
        self._report[left, _HOW] = FINE
        going = python[
            (self._report[python, _HOW] == FINE) & (self._report[python, _TAKEN] < self.context[WORLDS.steps])
        ]
        return np.sort(np.concatenate([left, going]))

    def failed(self, worlds: np.ndarray) -> dict[int, tuple[str, bool]]:
        """Return the worlds whose steps failed, each with the reason and whether its state diverged."""
        diverged = worlds[self._report[worlds, _HOW] == DIVERGED].tolist()
        return dict.fromkeys(diverged, (_HUGE, True)) | self._failed

    def put_back(self, worlds: np.ndarray) -> None:
        """Restore the state and counts of worlds to those before the call."""
        begun = worlds[self._report[worlds, _TAKEN] > 0]
        self._fields.state[begun] = self._first[begun]
        self._memory[worlds] = self._counted[worlds]

    def begin(self, worlds: np.ndarray) -> None:
        """Clear the counts of worlds."""
        self._memory[worlds] = 0.0

    def _step_in_python(self, world: int) -> None:
        """Take one step of a world in Python; if it fails, restore the world to its state before the call."""
        model, scheme, data = self._model, self._scheme, self._data
        if self._expanded:
            model = copy.copy(model)
            self._pool.write_model(world, model)
            scheme = _stepping(Way(model, self._plan, self._options, None), Moreau(0.0))
        scheme.set_law(self._way.law_for(self._law_of(world)))
        mujoco.mj_resetData(model, data)  # clears what a failed step of another world may have left
        restore_state(model, data, self._fields.state[world])
        missed = scheme.short_steps + scheme.unlocated
        try:
            events = scheme.step(data)
        except (ImpactLawError, mujoco.FatalError) as error:
            self._failed[world] = str(error), isinstance(error, DivergenceError)
            self._report[world, _HOW] = _FAILED
            self.put_back(np.array([world]))
            return
        sums = sums_of(events)
        missed = scheme.short_steps + scheme.unlocated - missed
        self._memory[world] += sums.collisions > 0, sums.inadmissible > 0, missed
        self._report[world, _HOW] = FINE
        self._report[world, _TAKEN] += 1
        self._fields.state[world] = save_state(model, data)
        if self._report[world, _TAKEN] == self.context[WORLDS.steps]:
            if self.context[WORLDS.forces]:
                mujoco.mj_rnePostConstraint(model, data)
            self._fields.write(world, data)

    def _law_of(self, world: int) -> Law:
        """Return the law of a world with the value written to `restitution`."""
        law, e = self.laws.given[world], float(self.laws.restitution[world])
        assert law is not None
        if np.isnan(e) or law.normal_law.common_coefficient == e:
            return law
        return replace(law, law=Moreau(e)) if isinstance(law, Coulomb) else Moreau(e)


def _convert(way: Way, scheme: SoftStepping, law: Law) -> Converted:
    scheme.set_law(way.law_for(law))
    check_covered(reason(scheme))
    return coefficients(scheme), settings(scheme)


def _stepping(way: Way, law: Law) -> SoftStepping:
    scheme = way.stepping(law)
    assert isinstance(scheme, SoftStepping)
    return scheme
