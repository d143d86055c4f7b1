"""Many worlds of one scene, time stepped under impact laws in MuJoCo's own thread pool."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw.batch.given import check_threads, keyframes, one_each, world_numbers
from impactlaw.batch.laws import Laws
from impactlaw.batch.rows import Fields
from impactlaw.errors import CopyError, SceneError, UnknownNameError, WorldsFailedError
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.stepping.compatibility import FRICTION, check_count, check_law, check_model, check_override, check_speed
from impactlaw.stepping.compiled.engine import Pool, functions, when_gone
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.left_out import watched_fields
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.time_stepping.compiled.borrow import room
from impactlaw.stepping.time_stepping.compiled.entry import WORLDS, many
from impactlaw.stepping.time_stepping.compiled.state import memory, status
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
}
_FORCES = ("cfrc_ext", "cfrc_int", "cacc")
"""Fields of mjData, which MuJoCo computes only where somebody asks: after the last step of a call."""
_DIVERGED = {status.HUGE_INPUT, status.HUGE_OUTPUT, status.NOT_FINITE}


class Batch:
    """Worlds of a copy of one model, time stepped in threads; the steps are those of `Stepper`.

    Mocap bodies move to the poses in ``bind("mocap_pos")`` and ``bind("mocap_quat")`` in one timestep, and have stopped
    in the next: whoever drives them calls ``step()`` for every timestep.

    Laws are those of one coefficient of restitution per contact, and the reversal; others are refused. Results do not
    depend on the number of threads. Derived fields are those of the end of a step where they are frames, else those of
    its middle.

    Some worlds are named by their numbers, ``ids``, ascending; without them all are meant.

    Args:
        model: the compiled scene.
        law: the law, or one for each world.
        nsim: number of worlds.
        nthread: number of threads; 0 for one per processor.
        friction: see `Stepper`.
        on_inadmissible: see `Stepper`.
        rest_speed: see `Stepper`.

    Attributes:
        model: the scene.
        state: MuJoCo's state rows, (nsim, nstate).
        restitution: e of each world, (nsim,), to be written; NaN where a law has more than one.

    Raises:
        SceneError: the scene, or the law, is not covered.
        OptionError: a number of worlds or threads, or a speed, that cannot be.
        UnknownNameError: an option has no such value, or a law is none.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law | Sequence[Law],
        nsim: int,
        nthread: int = 0,
        *,
        friction: Literal["coulomb", "convex", "ignore"] = "coulomb",
        on_inadmissible: Literal["raise", "project", "allow"] = "project",
        rest_speed: float | None = None,
    ):
        check_model(model)
        check_count("nsim", nsim)
        check_threads(nthread)
        check_speed("rest_speed", rest_speed)
        for kind, value, known in (
            ("friction option", friction, FRICTION),
            ("on_inadmissible option", on_inadmissible, ("raise", "project", "allow")),
        ):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        self.model, self.nsim = model, nsim
        plan = make_plan(model, scheme="time-stepping", friction=friction)
        check_override(model, plan)
        self._left_out = watched_fields(plan, friction)
        first = one_each(law, nsim)[0]
        options: Any = {"friction": friction, "on_inadmissible": on_inadmissible, "rest_speed": rest_speed}
        scheme = TimeStepping(model, first, plan, **options)
        self._pool = Pool(model, nsim, nthread, persistent=False)
        self._fields, self._functions = Fields(self._pool, model), functions()
        self.state = self._fields.state
        self._memory = memory.make_memory(model, nsim)
        self._laws = Laws(scheme, nsim)
        self.set_law(law)
        self._report = np.zeros((nsim, 2), np.int64)
        self._carriers, self._bilateral = scheme.carriers, constraint_kinds(scheme.model)
        self._slots = np.zeros((self.nthread + 1, 2), np.int64)
        when_gone(self, _free, self._memory, self._slots)
        self._context, self._table = np.zeros(len(WORLDS), np.int64), table()
        self._write_context()

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Refuse to be copied and pickled.

        Raises:
            CopyError: always.
        """
        raise CopyError(
            f"{type(self).__name__} cannot be copied or pickled: its worlds are in memory that compiled code holds; "
            "make another one, and copy the rows of `state`"
        )

    def _write_context(self) -> None:
        """Tell compiled code where all is."""
        arrays = {
            "table": self._table, "carriers": self._carriers, "bilateral": self._bilateral, "slots": self._slots,
            "settings_of": self._laws.settings, "laws_of": self._laws.places, "memory_of": self._memory,
            "status_of": self._report,
        }  # fmt: skip
        values = {name: array.ctypes.data for name, array in arrays.items()}
        values |= {
            "margin_count": room(self.model), "states": self.state.shape[1], "memories": self._memory.shape[1],
            "slot_count": len(self._slots),
        }  # fmt: skip
        for name, value in values.items():
            self._context[getattr(WORLDS, name)] = value

    @property
    def nthread(self) -> int:
        """Number of threads, the caller's included."""
        return self._functions.mjb_nthread(self._pool.handle)

    @property
    def restitution(self) -> np.ndarray:
        """E of each world, (nsim,), to be written, in [0, 1]; NaN where a law has more than one."""
        return self._laws.settings[:, SETTING.restitution]

    @property
    def impact_count(self) -> np.ndarray:
        """Steps of each world so far in which something collided, (nsim,)."""
        return self._memory[:, MEMORY.impacts].astype(int)

    @property
    def short_steps(self) -> np.ndarray:
        """Steps of each world so far that did not meet their law, (nsim,); see `Stepper.short_steps`."""
        return self._memory[:, MEMORY.short_steps].astype(int)

    @property
    def shortfall(self) -> np.ndarray:
        """Largest amount by which each world has missed its law so far, m/s or rad/s, (nsim,)."""
        return self._memory[:, MEMORY.worst].copy()

    def set_law(self, law: Law | Sequence[Law], ids: Sequence[int] | None = None) -> None:
        """Let the collisions of the next steps of some worlds, or all, be by another law, or one for each of them.

        Raises:
            SceneError: there is not one law for each of these worlds, or compiled code does not take it.
            RestitutionError: a law does not fit the scene.
            UnknownNameError: a law is none, or is keyed by contacts that the scene cannot have.
            OptionError: there are no such worlds.
        """
        worlds = world_numbers(ids, self.nsim, ascending=False).tolist()
        laws = one_each(law, len(worlds))
        for own in laws[:1] if isinstance(law, Law) else laws:
            check_law(self.model, own)
        if isinstance(law, Law):
            self._laws.set(law, worlds)
            return
        for world, own in zip(worlds, laws, strict=True):
            self._laws.set(own, [world])

    def bind(self, name: str) -> np.ndarray:
        """Return a live array over a field of mjData, (nsim, ..): of the state to be written, of others to be read.

        Raises:
            UnknownNameError: there is no such field.
            UnsupportedError: MuJoCo's batches do not have it, such as one without a fixed size.
        """
        found = self._fields.bind(name)
        self._context[WORLDS.forces] |= name in _FORCES
        self._context[WORLDS.outputs] = self._fields.outputs.ctypes.data
        self._context[WORLDS.output_count] = len(self._fields.outputs)
        return found

    def expand(self, name: str) -> np.ndarray:
        """Give a field of mjModel its own values in each world, (nsim, ..), to be written.

        Raises:
            UnknownNameError: there is no such field.
            UnsupportedError: MuJoCo's batches do not have it.
            SceneError: it tells about friction or contact, and the model of all worlds has none: worlds of this batch
                would not see it.
        """
        if name in self._left_out:
            raise SceneError(
                f"model.{name} of each world would have no effect: the model of this batch has no contact, or none "
                "with friction, and its steps leave that out; make the Batch of a model in which some contact has it"
            )
        found = self._fields.expand(name)
        if name in INERTIA:
            self._laws.see_inertial_forces()
        return found

    def step(self, ids: Sequence[int] | None = None, nstep: int = 1) -> None:
        """Take steps of some worlds, or all.

        Args:
            ids: numbers of the worlds.
            nstep: how many steps.

        Raises:
            OptionError: there are no such worlds, or nstep is no count.
            WorldsFailedError: some could not be stepped; these are as they were before the call.
            RestitutionError: a law does not know the restitution of a contact, and its world is as it was; or what was
                written to `restitution` is none.
        """
        check_count("nstep", nstep)
        worlds = None if ids is None else world_numbers(ids, self.nsim)
        self._laws.check()
        self._context[WORLDS.steps] = nstep
        self._report[slice(None) if worlds is None else worlds, 0] = status.FINE
        broken = self._call(worlds)
        while True:
            asked = np.flatnonzero(self._report[:, 0] == status.UNKNOWN).astype(np.int32)
            if not len(asked):
                break
            for world in asked:
                self._laws.learn(int(world), int(self._report[world, 1]))
            self._report[asked, 0] = status.FINE
            broken |= self._call(asked)
        if broken:
            failed = np.array(sorted(broken))
            self._memory.view(np.int64)[failed, MEMORY.known] = 0
            forget_surfaces(self._memory, failed, self.model)
            raise WorldsFailedError(failed.tolist(), self._pool.error(int(failed[0])))
        failed = np.flatnonzero(self._report[:, 0])
        if len(failed):
            how = self._report[failed, 0].tolist()
            self._report[failed, 0] = status.FINE
            raise WorldsFailedError(failed.tolist(), _WHY[how[0]], diverged=_DIVERGED.issuperset(how))

    def _call(self, worlds: np.ndarray | None) -> set[int]:
        """Let the pool step, and return the worlds of which MuJoCo has raised an error."""
        if not self._pool.apply(many.address, self._context.ctypes.data, worlds):
            return set()
        raised = (ctypes.c_int * self.nsim).from_address(self._functions.mjb_status(self._pool.handle))
        return {i for i, status in enumerate(raised) if status}

    def reset(self, ids: Sequence[int] | None = None, keyframe: int | Sequence[int] = -1) -> None:
        """Put some worlds, or all, back to the start or to a keyframe, with nothing to remember.

        Args:
            ids: numbers of the worlds.
            keyframe: number of the keyframe, -1 for the start; or one for each of these worlds.

        Raises:
            OptionError: there are no such worlds or keyframes.
            WorldsFailedError: MuJoCo cannot do that in some.
        """
        worlds = world_numbers(ids, self.nsim)
        key = keyframes(keyframe, len(worlds), self.model.nkey)
        level = int(mujoco.mjtStage.mjSTAGE_ACC)
        if self._functions.mjb_reset(self._pool.handle, worlds.ctypes.data, len(worlds), key.ctypes.data, level):
            raise WorldsFailedError(worlds.tolist(), self._pool.error(int(worlds[0])))
        memory.begin(self._memory, worlds, self.model)

    def forward(self, ids: Sequence[int] | None = None) -> None:
        """Bring the bound fields of some worlds, or all, up to their state.

        Raises:
            OptionError: there are no such worlds.
            WorldsFailedError: MuJoCo cannot do that in some.
        """
        worlds = world_numbers(ids, self.nsim)
        level = int(mujoco.mjtStage.mjSTAGE_ACC)
        if self._functions.mjb_forward(self._pool.handle, worlds.ctypes.data, len(worlds), level):
            raise WorldsFailedError(worlds.tolist(), self._pool.error(int(worlds[0])))

    def get_data(self, world: int) -> mujoco.MjData:
        """Return the state of a world as data of its own.

        Raises:
            OptionError: there is no such world.
        """
        (number,) = world_numbers([world], self.nsim)
        data: Any = mujoco.MjData(self.model)
        self._functions.mjb_getData(self._pool.handle, int(number), data._address)
        return data


def _free(numbers: np.ndarray, slots: np.ndarray) -> None:
    """Give back what the worlds remember, and the other data of each thread."""
    memory.free(numbers)
    for _, other in slots:
        if other:
            functions().mj_deleteData(int(other))
