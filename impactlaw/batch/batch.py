"""Step many worlds of one scene under impact laws, time stepped or with soft contact, in MuJoCo's thread pool."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw.batch.given import check_callbacks, check_name, check_threads, keyframes, one_each, world_numbers
from impactlaw.batch.rows import Fields
from impactlaw.compiled import compile_together
from impactlaw.errors import CopyError, SceneError, SettledError, WorldsFailedError
from impactlaw.laws import Law
from impactlaw.laws.restitution.from_scene import carries_restitution
from impactlaw.settled import Settled, places
from impactlaw.stepping.cautions import warn_of_held_joints
from impactlaw.stepping.compatibility import check_count, check_friction, check_law, check_model, check_scene_friction
from impactlaw.stepping.compiled.engine import Pool, functions
from impactlaw.stepping.integration import check_timestep
from impactlaw.stepping.options import Options
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.plan_check import watched_fields

_ANEW = "make another Batch"
_FORCES = ("cfrc_ext", "cfrc_int", "cacc")
"""Fields of mjData that MuJoCo computes only on request; if bound, they are computed after the last step of a call."""


class Batch:
    """Many worlds of one model, stepped in threads as `Stepper` steps one: by time stepping, or with soft contact.

    The worlds share a copy of the model. Results do not depend on the number of threads.

    A batch accepts laws with one coefficient of restitution per contact, and the reversal law if contact is rigid. It
    refuses all other laws, and scenes whose soft steps are not compiled.

    If contact is rigid, a mocap body moves to its pose in ``bind("mocap_pos")`` and ``bind("mocap_quat")`` within one
    timestep and is at rest in the next. To keep mocap bodies moving, call ``step()`` once per timestep.

    Derived fields are as `Stepper` leaves them in data. After a rigid step, frames belong to the end of the step and
    other fields to its middle; after a soft step, all are as `mj_step` leaves them.

    Methods with an argument ``ids`` act on the worlds with these numbers, in ascending order, or on all worlds if it is
    None.

    Args:
        model: the compiled scene.
        law: the law of all worlds, or a sequence of one law per world.
        nsim: number of worlds.
        nthread: number of threads; 0 for one per processor.
        contact_model: see `Stepper`; "rigid" contact is time stepped.
        friction: see `Stepper`.
        on_inadmissible: see `Stepper`; "project" if not given (rigid). It is refused for soft contact, where a law with
            one coefficient per contact creates no energy.
        rest_speed: see `Stepper`.

    Attributes:
        model: the scene from which the worlds were made. Later changes to it, such as to masses or gravity, do not
            reach the worlds: `expand` a field to change it.
        state: MuJoCo's state vectors, one row per world, (nsim, nstate), writable.

    Raises:
        SceneError: the scene or the law is not covered, the timestep is not positive, or a callback of MuJoCo is set.
        RestitutionError: as raised by `set_law`.
        OptionError: the number of worlds or threads, or rest_speed, is invalid.
        UnknownNameError: an option has no such value, or law holds an object that is not a `Law`.
        UncompilableError: numba cannot be imported.

    Warns:
        HeldJointsWarning: as `Stepper` does (rigid).
    """

    model, nsim, contact_model = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    state = Settled("write into it, as state[:] = ...")
    __slots__ = (
        *places("model", "nsim", "contact_model", "state"),
        *("_left_out", "_friction", "_pool", "_fields", "_functions", "_worlds", "_laws", "__weakref__"),
    )

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law | Sequence[Law],
        nsim: int,
        nthread: int = 0,
        *,
        contact_model: Literal["rigid", "soft"] = "rigid",
        friction: Literal["coulomb", "convex", "ignore"] | None = None,
        on_inadmissible: Literal["raise", "project", "allow"] | None = None,
        rest_speed: float | None = None,
    ):
        check_model(model)
        check_timestep(model.opt.timestep)
        check_callbacks()
        check_count("nsim", nsim)
        check_threads(nthread)
        options = _options(contact_model, friction, on_inadmissible, rest_speed)
        self.model, self.nsim, self.contact_model, self._friction = model, nsim, contact_model, friction
        if contact_model == "rigid":
            warn_of_held_joints(model, stacklevel=3)
        plan = make_plan(model, contact_model, scheme=options.scheme, friction=friction or "coulomb")
        check_scene_friction(model, plan)
        self._left_out = watched_fields(plan, friction or "coulomb")
        first = one_each(law, nsim)[0]
        try:
            self._pool = Pool(model, nsim, nthread, persistent=False)
        except mujoco.FatalError as error:
            raise SceneError(f"MuJoCo makes no batch of this scene: {error}; use Stepper") from None
        self._fields, self._functions = Fields(self._pool, model), functions()
        self.state = self._fields.state
        if contact_model == "soft":
            compile_together("impactlaw.stepping.soft.compiled.batch_entry")
            from impactlaw.batch.soft import SoftWorlds as Worlds
        else:
            compile_together("impactlaw.stepping.time_stepping.compiled.entry")
            from impactlaw.batch.rigid import RigidWorlds as Worlds
        self._worlds = Worlds(model, plan, first, options, self._pool, self._fields)
        self._laws = self._worlds.laws
        self.set_law(law)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Raise CopyError: a batch cannot be copied or pickled."""
        raise CopyError(
            f"{type(self).__name__} cannot be copied or pickled: its worlds are in memory that compiled code holds; "
            "make another one, and copy the rows of `state`"
        )

    @property
    def nthread(self) -> int:
        """Number of threads, the caller's included."""
        return self._pool.threads

    @property
    def law(self) -> tuple[Law, ...]:
        """The law last given to each world, whatever was written to `restitution` since; assigning calls `set_law`."""
        return tuple(self._laws.given)

    @law.setter
    def law(self, law: Law | Sequence[Law]) -> None:
        self.set_law(law)

    @property
    def restitution(self) -> np.ndarray:
        """Restitution e of each world, (nsim,), writable, in [0, 1]; NaN where a law has several coefficients."""
        return self._laws.restitution

    @restitution.setter
    def restitution(self, value: object) -> None:
        if value is self._laws.restitution:  # written in place, as by *=
            return
        raise SettledError(
            f"restitution of Batch is settled when it is made, and cannot be set to {value!r:.100} later; write into "
            "it, as restitution[:] = ..."
        )

    @property
    def impact_count(self) -> np.ndarray:
        """Number of steps of each world so far with at least one collision, (nsim,)."""
        return self._worlds.count("impacts")

    @property
    def inadmissible_count(self) -> np.ndarray:
        """Steps counted by `impact_count` in which the law's outcome left S(v-) and was scaled or allowed, (nsim,)."""
        return self._worlds.count("inadmissible")

    @property
    def short_steps(self) -> np.ndarray:
        """Steps of each world so far that missed the law, (nsim,): `Stepper.short_steps` plus `Stepper.unlocated`."""
        return self._worlds.count("short_steps")

    @property
    def shortfall(self) -> np.ndarray:
        """Largest amount by which a normal velocity of each world has missed the law so far, m/s or rad/s, (nsim,)."""
        return self._worlds.shortfall

    def set_law(self, law: Law | Sequence[Law], ids: Sequence[int] | None = None) -> None:
        """Give some worlds, or all, another law, or one law each; it takes effect with their next step.

        If one of the laws is refused, no world's law changes.

        Args:
            law: the law of these worlds, or a sequence of one law per world.
            ids: numbers of the worlds, in any order.

        Raises:
            SceneError: the number of laws is not that of the worlds, or compiled code does not cover a law.
            RestitutionError: a law does not fit the scene, or its friction contradicts that of the batch.
            UnknownNameError: law holds an object that is not a `Law`, or a law is keyed by contacts that the scene
                cannot have.
            OptionError: there is no world with such a number, or a number is given twice.
        """
        worlds = world_numbers(ids, self.nsim, ascending=False).tolist()
        laws = one_each(law, len(worlds))
        for own in laws[:1] if isinstance(law, Law) else laws:
            check_law(self.model, own)
            check_friction(own, self._friction)
        self._laws.set(laws, worlds)

    def bind(self, name: str) -> np.ndarray:
        """Return a live array over a field of mjData, (nsim, ..).

        Fields that are part of the state are writable, others are read-only.

        Raises:
            UnknownNameError: there is no such field.
            UnsupportedError: MuJoCo's batches cannot bind the field, for example because its size varies.
        """
        check_name(name)
        found = self._fields.bind(name)
        context, places = self._worlds.context, self._worlds.places
        context[places.forces] |= name in _FORCES
        context[places.outputs] = self._fields.outputs.ctypes.data
        context[places.output_count] = len(self._fields.outputs)
        return found

    def expand(self, name: str) -> np.ndarray:
        """Give each world its own values of a field of mjModel, and return them as a writable array, (nsim, ..).

        Raises:
            UnknownNameError: there is no such field.
            UnsupportedError: MuJoCo's batches cannot expand the field.
            SceneError: the field would have no effect: it concerns contact, friction or moving surfaces, of which the
                batch's model has none; or it is ``numeric_data``, and the scene carries restitution there.
        """
        check_name(name)
        if name in self._left_out:
            raise SceneError(
                f"model.{name} of each world would have no effect: the model of this batch has no contact, none with "
                "friction, or no surface that moves, and its steps leave that out; make a Batch of a model that has it"
            )
        if name == "numeric_data" and carries_restitution(self.model):
            raise SceneError(
                "model.numeric_data of each world would have no effect: a batch does not read the restitution that the "
                "scene carries there; write into `restitution` of the batch, or use set_law"
            )
        found = self._fields.expand(name)
        self._worlds.expand(name)
        return found

    def expanded(self, name: str) -> np.ndarray | None:
        """Return the array that `expand` made for a field, (nsim, ..), or None if all worlds share the model's values.

        Raises:
            UnknownNameError: there is no such field.
        """
        check_name(name)
        return self._fields.expanded(name)

    def step(self, ids: Sequence[int] | None = None, nstep: int = 1) -> None:
        """Advance some worlds, or all, by a number of steps.

        Args:
            ids: numbers of the worlds.
            nstep: number of steps.

        Raises:
            OptionError: there is no world with such a number, or nstep is not a positive integer.
            SceneError: a callback of MuJoCo is set.
            WorldsFailedError: some worlds could not be stepped; they are as they were before the call.
            RestitutionError: a law has no coefficient for a contact, and its world is as it was before the call; or a
                value written to `restitution` is not in [0, 1].
        """
        check_count("nstep", nstep)
        worlds = world_numbers(ids, self.nsim)
        check_callbacks()
        self._laws.check()
        self._worlds.start(worlds, nstep)
        failed, left = dict[int, tuple[str, bool]](), worlds
        while len(left):
            failed |= self._call(left)
            left = self._worlds.go_on(worlds)
        if failed := self._worlds.failed(worlds) | failed:
            numbers = sorted(failed)
            raise WorldsFailedError(numbers, failed[numbers[0]][0], diverged=all(far for _, far in failed.values()))

    def _call(self, worlds: np.ndarray) -> dict[int, tuple[str, bool]]:
        """Step in the pool, restore the worlds in which MuJoCo raised an error, and return its messages by world."""
        if not self._pool.apply(self._worlds.address, self._worlds.context.ctypes.data, worlds):
            return {}
        status = (ctypes.c_int * self.nsim).from_address(self._functions.mjb_status(self._pool.handle))
        broken = [world for world in worlds.tolist() if status[world]]
        self._worlds.put_back(np.array(broken))
        return {world: (self._pool.error(world), False) for world in broken}

    def reset(self, ids: Sequence[int] | None = None, keyframe: int | Sequence[int] = -1) -> None:
        """Reset some worlds, or all, to the initial state or a keyframe, with their counts and data of the last step.

        Args:
            ids: numbers of the worlds.
            keyframe: number of the keyframe, -1 for the initial state; or a sequence of one number per world.

        Raises:
            OptionError: there is no such world or keyframe.
            SceneError: a callback of MuJoCo is set.
            WorldsFailedError: MuJoCo failed to reset some worlds.
        """
        worlds = world_numbers(ids, self.nsim)
        check_callbacks()
        key = keyframes(keyframe, len(worlds), self.model.nkey)
        level = int(mujoco.mjtStage.mjSTAGE_ACC)
        if self._functions.mjb_reset(self._pool.handle, worlds.ctypes.data, len(worlds), key.ctypes.data, level):
            raise WorldsFailedError(worlds.tolist(), self._pool.error(int(worlds[0])))
        self._worlds.begin(worlds)

    def forward(self, ids: Sequence[int] | None = None) -> None:
        """Compute the bound fields of some worlds, or all, from their state, as `mj_forward` does.

        Raises:
            OptionError: there is no world with such a number.
            SceneError: a callback of MuJoCo is set.
            WorldsFailedError: MuJoCo failed in some worlds.
        """
        worlds = world_numbers(ids, self.nsim)
        check_callbacks()
        level = int(mujoco.mjtStage.mjSTAGE_ACC)
        if self._functions.mjb_forward(self._pool.handle, worlds.ctypes.data, len(worlds), level):
            raise WorldsFailedError(worlds.tolist(), self._pool.error(int(worlds[0])))

    def get_data(self, world: int) -> mujoco.MjData:
        """Return the state of a world in a new `mujoco.MjData`.

        Raises:
            OptionError: there is no world with this number.
        """
        (number,) = world_numbers([world], self.nsim)
        data: Any = mujoco.MjData(self.model)
        self._functions.mjb_getData(self._pool.handle, int(number), data._address)
        return data


def _options(contact_model: Any, friction: Any, on_inadmissible: Any, rest_speed: float | None) -> Options:
    """Return the options, checked, of a stepper that takes the same steps as the worlds of a batch."""
    soft = contact_model == "soft"
    options = Options(
        contact_model=contact_model, scheme=None if soft else "time-stepping", friction=friction,
        on_inadmissible=on_inadmissible or "project", rest_speed=rest_speed, compiled="never" if soft else None,
    )  # fmt: skip
    options.check()
    if soft and on_inadmissible is not None:
        raise SceneError("on_inadmissible means nothing to a soft batch, whose laws create no energy; leave it out")
    return options
