"""Read laws of a study from text such as "moreau:0.5", or "moreau|reversal:0.4..1" for a law drawn per episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.errors import StudyError, UnknownNameError
from impactlaw.laws import LAWS, make_law, portable, takes_restitution

MUJOCO = "mujoco"
"""MuJoCo's own contacts, without a law."""
_SCENE = "scene"  # the restitution that the MJCF carries, pair by pair


@dataclass(frozen=True)
class StatedLaw:
    """A law as given in a study: one law, one that is drawn for each episode, or MuJoCo's own contacts."""

    text: str  # the text as given
    # names of laws, or laws as plain values (`impactlaw.laws.portable`), of which each episode has one
    laws: tuple[str | Mapping[str, Any], ...]
    # lowest and highest coefficient of restitution, equal if there is only one; None if the laws take none, or take
    # that of the scene
    restitution: tuple[float, float] | None = None

    @property
    def is_mujoco(self) -> bool:
        """Whether this stands for MuJoCo's own contacts."""
        return self.laws == (MUJOCO,)

    @property
    def is_drawn(self) -> bool:
        """Whether a law or a restitution is drawn for each episode."""
        return len(self.laws) > 1 or (self.restitution is not None and self.restitution[0] < self.restitution[1])

    @property
    def coefficient(self) -> float | None:
        """The coefficient of restitution that all episodes have in common; None if there is none."""
        if self.laws == ("maximal-dissipation",):
            return 0.0
        return None if self.restitution is None or self.is_drawn else self.restitution[0]

    def distribution(self) -> LawDistribution:
        """Return the distribution of the law of an episode, uniform over laws and over the range of restitution."""
        return LawDistribution(self.laws, self.restitution)

    def settings(self) -> dict[str, Any]:
        """Return plain values that identify this law."""
        return {"laws": list(self.laws), "restitution": self.restitution and list(self.restitution)}


def read_law(text: str) -> StatedLaw:
    """Return the law, or laws, described by a text.

    Args:
        text: names of laws, separated by "|", then ":" and the restitution if the laws take one: a number, or a range
            as in "moreau:0.4..1". A file written by `impactlaw identify`, such as ``law.json``, is also a law. "mujoco"
            stands for MuJoCo's own contacts.

    Raises:
        StudyError: the text does not have this form.
        UnknownNameError: there is no law with such a name.
        RestitutionError: the restitution does not fit the law.
    """
    if not isinstance(text, str) or not text:
        raise StudyError(f'a law is stated as a text such as "moreau:0.5", got {text!r}')
    names, _, coefficient = text.partition(":")
    laws = tuple(_named(name) for name in names.split("|"))
    restitution = _range(text, coefficient) if ":" in text else None
    if MUJOCO in laws and (len(laws) > 1 or restitution is not None):
        raise StudyError(f"{text!r}: MuJoCo's own contacts are not drawn, and have no restitution")
    if len({str(law) for law in laws}) < len(laws):
        raise StudyError(f"{text!r} names a law twice")
    if restitution is not None:
        taking = [law for law in laws if law not in (_SCENE, MUJOCO) and takes_restitution(law)]
        if not taking:
            raise StudyError(f"{text!r}: {names} takes no restitution")
        for law, e in product(taking, restitution):
            make_law(law, e)  # raises if the restitution does not fit the law
    return StatedLaw(text, laws, restitution)


def _named(name: str) -> str | Mapping[str, Any]:
    if name.endswith(".json"):
        return portable(make_law(name))
    if name not in (*LAWS, _SCENE, MUJOCO):
        raise UnknownNameError("law", name, [*LAWS, _SCENE, MUJOCO])
    return name


def _range(text: str, coefficient: str) -> tuple[float, float]:
    low, dots, high = coefficient.partition("..")
    try:
        ends = float(low), float(high if dots else low)
    except ValueError:
        raise StudyError(f"{text!r}: {coefficient!r} is neither a number nor a range such as 0.4..1") from None
    if not all(map(math.isfinite, ends)):
        raise StudyError(f"{text!r}: a restitution is a finite number, got {coefficient!r}")
    if ends[0] > ends[1]:
        raise StudyError(f"{text!r}: a range goes from a lower to a higher number, got {coefficient!r}")
    return ends
