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
from impactlaw.envs.law_in_force import goes_with_restitution, way_out
from impactlaw.envs.law_options import choose_law, describe_law
from impactlaw.envs.vector.asked_laws import Asked, each
from impactlaw.errors import OptionError, UnknownNameError
from impactlaw.laws import Law

OF_BATCH = ("friction", "on_inadmissible", "rest_speed")
"""Options of `Batch` that worlds can be given."""


class LawsOfWorlds:
    """Makes worlds that have laws, and gives them others.

    Args:
        model: of all worlds.
        law: of all worlds, or of each, or what each draws the law of each episode from.
        count: number of worlds.
        contact_model: of `Batch`.
        nthread: number of threads; 0 for one per processor.
        options: of `Batch`, see `OF_BATCH`.

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
                self.batch.set_law(one.law, [0])  # which refuses what compiled code does not take

    @property
    def in_force(self) -> tuple[Law, ...]:
        """The law in force in each world."""
        return tuple(one.law for one in self._now)

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
        asked = {world: self._of_episode(world, given, sources.get(world)) for world in worlds}
        changed = [world for world, one in asked.items() if drawn or one is not self._now[world]]
        self._use(changed, [asked[world] for world in changed])
        for world, source in sources.items():
            self._sources[world] = source

    def set(self, name: str, values: Any) -> None:
        """Let "law" or "restitution" of all worlds be another, or one for each, from now on; none is drawn any more.

        A restitution goes with a law that was given by its name: the one in force, and the one that stands, if an
        episode has another one.

        Raises:
            OptionError: there is not one for each world.
            UnknownNameError: no such law; all stay what they were.
            RestitutionError: the restitution does not fit the law; all stay what they were.
            SceneError: compiled code does not take a law; all stay what they were.
        """
        every = each(f"values of {name}", values, len(self._own))
        now, own = zip(*(self._changed(world, name, value) for world, value in enumerate(every)), strict=True)
        self._use(range(len(now)), now)
        self._own, self._distribution = list(own), None

    def _changed(self, world: int, name: str, value: Any) -> tuple[Asked, Asked]:
        """Return what is in force in a world, and what stands there, where one of its options is another."""
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
        """Return the laws in force, as a vector environment tells them."""
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


def _examples(laws: LawDistribution, model: mujoco.MjModel) -> list[Asked]:
    """Return one law of each kind; refuse friction that is to be drawn, too."""
    if laws.friction is not None:
        raise OptionError("friction of many worlds is settled when they are made (batch_options): leave it out of laws")
    examples = [(given["law"], given.get("restitution")) for given in laws.examples()]
    return [Asked(law, choose_law(model, law, e)) for law, e in examples]
