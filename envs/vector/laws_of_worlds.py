"""The laws of many worlds: the standing laws, and those in force in the current episodes."""

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
from impactlaw.envs.law_in_force import goes_with_restitution, way_out
from impactlaw.envs.law_options import choose_law, describe_law
from impactlaw.envs.vector.asked_laws import Asked, each
from impactlaw.errors import OptionError, UnknownNameError
from impactlaw.laws import Law

OF_BATCH = ("friction", "on_inadmissible", "rest_speed")
"""Options of `Batch` that can be given to worlds."""


class LawsOfWorlds:
    """A batch of worlds and the laws of each, standing and in force.

    Args:
        model: the model of all worlds.
        law: the law of all worlds, a list of one law per world, or a distribution from which each episode draws one.
        count: number of worlds.
        contact_model: option of `Batch`.
        nthread: number of threads; 0 for one per processor.
        options: further options of `Batch`, see `OF_BATCH`.

    Attributes:
        batch: the worlds.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Asked | list[Asked] | LawDistribution,
        count: int,
        *,
        contact_model: Literal["rigid", "soft"],
        nthread: int,
        options: Mapping[str, Any],
    ):
        self._model = model
        self._distribution = law if isinstance(law, LawDistribution) else None
        first = _examples(law, model)[0] if isinstance(law, LawDistribution) else law
        laws = first.law if isinstance(first, Asked) else [one.law for one in first]
        _check_options(options)
        self.batch = Batch(model, laws, count, nthread, contact_model=contact_model, **options)
        self._own = [first] * count if isinstance(first, Asked) else list(first)
        self._now = list(self._own)
        self._sources = [EpisodeSeeds(LAWS) for _ in range(count)]
        self._named: dict[str, np.ndarray] = {}
        if self._distribution is None:
            for world, one in enumerate(self._own):
                self._name(world, one.law)
        else:
            for one in _examples(self._distribution, model):
                self.batch.set_law(one.law, [0])  # raises if compiled code does not cover the law

    @property
    def in_force(self) -> tuple[Law, ...]:
        """The law in force in each world."""
        return tuple(one.law for one in self._now)

    def begin(self, worlds: Sequence[int], given: Mapping[str, Any], seeds: Sequence[int | None]) -> None:
        """Set the laws of episodes that begin: those given, those drawn, or the standing ones.

        If a law is refused, no law changes, and no random number is used up.

        Args:
            worlds: numbers of the worlds.
            given: options "law" and "restitution", if given.
            seeds: for each of these worlds a seed for drawing its laws, or None to continue its generator.
        """
        drawn = self._distribution is not None
        sources = {world: copy.deepcopy(self._sources[world]) for world in worlds} if drawn else {}
        for source, seed in zip(sources.values(), seeds, strict=False):  # sources is empty if no laws are drawn
            source.begin(seed)
        asked = {world: self._of_episode(world, given, sources.get(world)) for world in worlds}
        changed = [world for world, one in asked.items() if drawn or one is not self._now[world]]
        self._use(changed, [asked[world] for world in changed])
        for world, source in sources.items():
            self._sources[world] = source

    def set(self, name: str, values: Any) -> None:
        """Set "law" or "restitution" of all worlds, to one value or one per world, permanently; end drawing of laws.

        A restitution is combined with the law that was given by name: with the law in force and, if the episode has a
        law of its own, also with the standing law.

        Raises:
            OptionError: the number of values is not that of the worlds.
            UnknownNameError: there is no such law; no law changes.
            RestitutionError: the restitution does not fit the law; no law changes.
            SceneError: compiled code does not cover a law; no law changes.
        """
        every = each(f"values of {name}", values, len(self._own))
        now, own = zip(*(self._changed(world, name, value) for world, value in enumerate(every)), strict=True)
        self._use(range(len(now)), now)
        self._own, self._distribution = list(own), None

    def _changed(self, world: int, name: str, value: Any) -> tuple[Asked, Asked]:
        """Return the law in force and the standing law of a world, after a change of one option."""
        own, now, options = self._own[world], self._now[world], {name: value}
        together = name == "law" or own is now or self._distribution is not None
        asked = (now,) if together else (now, own)
        if name == "law":
            is_needed = goes_with_restitution(value)
        else:
            is_needed = not all(goes_with_restitution(one.given) for one in asked)
        with way_out(is_needed, "vec"):
            changed = [one.other(self._model, options) for one in asked]
        return changed[0], changed[-1]

    def info(self) -> dict[str, np.ndarray]:
        """Return the entries of a vector environment's info about the laws in force."""
        told = {name: value.copy() for name, value in self._named.items()}
        has_one = ~np.isnan(told["impact/restitution"])
        return told | {"_impact/law": np.ones(len(has_one), bool), "_impact/restitution": has_one}

    def _of_episode(self, world: int, given: Mapping[str, Any], source: EpisodeSeeds | None) -> Asked:
        if self._distribution is not None and source is not None:
            given = self._distribution.draw(source.generator, given) | dict(given)
        return self._own[world].other(self._model, given) if given else self._own[world]

    def _use(self, worlds: Sequence[int], asked: Sequence[Asked]) -> None:
        self.batch.set_law([one.law for one in asked], worlds)
        for world, one in zip(worlds, asked, strict=True):
            self._now[world] = one
            self._name(world, one.law)

    def _name(self, world: int, law: Law) -> None:
        for name, value in ({"impact/restitution": math.nan} | describe_law(law)).items():
            kind: Any = object if isinstance(value, str) else float
            self._named.setdefault(name, np.zeros(len(self._own), kind))[world] = value


def _check_options(options: Any) -> None:
    """Check that options of a batch are a mapping of `OF_BATCH`."""
    if not isinstance(options, Mapping):
        raise OptionError(f"batch_options is a mapping of {', '.join(OF_BATCH)} to values, got {options!r:.100}")
    for name in options:
        if name not in OF_BATCH:
            raise UnknownNameError("option of a batch", name, OF_BATCH)


def _examples(laws: LawDistribution, model: mujoco.MjModel) -> list[Asked]:
    """Return one example of each law of a distribution; raise OptionError if it also draws friction."""
    if laws.friction is not None:
        raise OptionError("friction of many worlds is settled when they are made (batch_options): leave it out of laws")
    examples = [(given["law"], given.get("restitution")) for given in laws.examples()]
    return [Asked(law, choose_law(model, law, e)) for law, e in examples]
