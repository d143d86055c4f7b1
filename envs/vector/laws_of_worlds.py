"""The laws of many worlds: which stand, and which are in force in the episodes of now."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw.batch import Batch
from impactlaw.envs.episode_seeds import LAWS, EpisodeSeeds
from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_options import choose_law, describe_law
from impactlaw.envs.vector.asked_laws import each, several
from impactlaw.errors import OptionError, RestitutionError, UnknownNameError
from impactlaw.laws import Law

OF_BATCH = ("friction", "on_inadmissible", "rest_speed")
"""Options of `Batch` that worlds can be given."""


class LawsOfWorlds:
    """Makes worlds that have laws, and gives them others.

    Args:
        model: of all worlds.
        law: as `VectorWorlds` takes it.
        count: number of worlds.
        contact_model: of `Batch`.
        nthread: number of threads; 0 for one per processor.
        options: of `Batch`, see `OF_BATCH`.

    Attributes:
        batch: the worlds.
        in_force: the law in force in each world.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: str | Law | Sequence[str | Law] | LawDistribution,
        count: int,
        *,
        contact_model: Literal["rigid", "soft"],
        nthread: int,
        options: Mapping[str, Any],
    ):
        self._model = model
        self._distribution = law if isinstance(law, LawDistribution) else None
        first = _first_laws(law, model, count)
        _check_options(options)
        self.batch = Batch(model, first, count, nthread, contact_model=contact_model, **options)
        self._own = [first] * count if isinstance(first, Law) else first
        self.in_force = list(self._own)
        self._sources = [EpisodeSeeds(LAWS) for _ in range(count)]
        self._named: dict[str, np.ndarray] = {}
        if self._distribution is None:
            for world, one in enumerate(self._own):
                self._name(world, one)
        else:
            for one in _examples(self._distribution, model):
                self.batch.set_law(one, [0])  # which refuses what compiled code does not take

    def begin(self, worlds: Sequence[int], given: Mapping[str, Any], seeds: Sequence[int | None]) -> None:
        """Let worlds have the laws of the episodes that begin: as given, drawn, or their own.

        If one fails, all stay what they were, and nothing is drawn.

        Args:
            worlds: their numbers.
            given: "law" and "restitution", if they are given.
            seeds: of each of these worlds, from which its laws are drawn anew; None to go on.
        """
        drawn = self._distribution is not None
        sources = {world: copy.deepcopy(self._sources[world]) for world in worlds} if drawn else {}
        for source, seed in zip(sources.values(), seeds, strict=False):  # none, if no laws are drawn
            source.begin(seed)
        laws = {world: self._of_episode(world, given, sources.get(world)) for world in worlds}
        changed = [world for world, law in laws.items() if drawn or law is not self.in_force[world]]
        self._use(changed, [laws[world] for world in changed])
        for world, source in sources.items():
            self._sources[world] = source

    def set(self, name: str, values: Any) -> None:
        """Let "law" or "restitution" of all worlds be another, or one for each, from now on; none is drawn any more.

        A restitution goes with the law that is in force.

        Raises:
            OptionError: there is not one for each world.
            UnknownNameError: no such law; all stay what they were.
            RestitutionError: the restitution does not fit the law; all stay what they were.
            SceneError: compiled code does not take a law; all stay what they were.
        """
        every = each(f"values of {name}", values, len(self._own))
        pairs = zip(self.in_force, every, strict=True)
        chosen = [self._asked(law, {name: value}) for law, value in pairs]
        self._use(range(len(chosen)), chosen)
        self._own, self._distribution = chosen, None

    def info(self) -> dict[str, np.ndarray]:
        """Return the laws in force, as a vector environment tells them."""
        every = np.ones(len(self._own), bool)
        told = {name: value.copy() for name, value in self._named.items()}
        return told | {f"_{name}": every for name in told}

    def _of_episode(self, world: int, given: Mapping[str, Any], source: EpisodeSeeds | None) -> Law:
        if self._distribution is not None and source is not None:
            given = self._distribution.draw(source.generator, given) | dict(given)
        return self._asked(self._own[world], given) if given else self._own[world]

    def _asked(self, own: Law, given: Mapping[str, Any]) -> Law:
        """Return the law that options ask for; a world's own with another restitution if they name none."""
        if "law" not in given:
            if not own.name or math.isnan(float(describe_law(own)["impact/restitution"])):
                raise RestitutionError(f"{own!r:.100} has its restitution already: set a law instead")
            return choose_law(self._model, own.name, given.get("restitution"))
        return choose_law(self._model, given["law"], given.get("restitution"))

    def _use(self, worlds: Sequence[int], laws: Sequence[Law]) -> None:
        self.batch.set_law(laws, worlds)
        for world, law in zip(worlds, laws, strict=True):
            self.in_force[world] = law
            self._name(world, law)

    def _name(self, world: int, law: Law) -> None:
        for name, value in describe_law(law).items():
            kind: Any = object if isinstance(value, str) else float
            self._named.setdefault(name, np.zeros(len(self._own), kind))[world] = value


def _check_options(options: Any) -> None:
    """Refuse options that a batch does not have.

    Raises:
        OptionError: they are no mapping.
        UnknownNameError: there is no such option.
    """
    if not isinstance(options, Mapping):
        raise OptionError(f"batch_options is a mapping of {', '.join(OF_BATCH)} to values, got {options!r:.100}")
    for name in options:
        if name not in OF_BATCH:
            raise UnknownNameError("option of a batch", name, OF_BATCH)


def _first_laws(law: Any, model: mujoco.MjModel, count: int) -> Law | list[Law]:
    """Return the law that so many worlds begin with, or one for each."""
    if isinstance(law, LawDistribution):
        return _examples(law, model)[0]
    return [choose_law(model, one) for one in each("laws", law, count)] if several(law) else choose_law(model, law)


def _examples(laws: LawDistribution, model: mujoco.MjModel) -> list[Law]:
    """Return one law of each kind; refuse friction that is to be drawn, too."""
    if laws.friction is not None:
        raise OptionError("friction of many worlds is settled when they are made (batch_options): leave it out of laws")
    return [choose_law(model, given["law"], given.get("restitution")) for given in laws.examples()]
