"""The laws that worlds are made with: one for all of them, or one for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_options import choose_law
from impactlaw.errors import OptionError, RestitutionError
from impactlaw.laws import Law


class Asked(NamedTuple):
    """The law of a world, and what it was asked for by.

    Attributes:
        given: a law, which has its restitution, or the name of one, which other restitutions go with.
        law: the law.
    """

    given: Any
    law: Law

    def other(self, model: mujoco.MjModel, options: Mapping[str, Any]) -> Asked:
        """Return what is asked for by "law" and "restitution", or by one of them.

        Raises:
            UnknownNameError: no such law.
            RestitutionError: the restitution does not fit the law.
        """
        given = options.get("law", self.given)
        return Asked(given, choose_law(model, given, options.get("restitution")))


def asked_laws(
    model: mujoco.MjModel, law: Any, restitution: Any, count: int, *, usual: float | None = None
) -> Asked | list[Asked] | LawDistribution:
    """Return the law of so many worlds, one for all or one for each.

    Args:
        model: of all worlds.
        law: a law or its name, or a list with one for each world, or a `LawDistribution`.
        restitution: what laws by their names take, or a list or an array with one for each world; None for the scene's
            own.
        count: number of worlds.
        usual: restitution of a law that needs one, where none is given and the scene has none.

    Raises:
        OptionError: there is not one for each world.
        UnknownNameError: no such law.
        RestitutionError: the restitution does not fit a law, or a law has its own.
    """
    if isinstance(law, LawDistribution):
        if restitution is not None:
            raise RestitutionError(f"a LawDistribution has its own restitution; leave restitution={restitution!r} out")
        return law
    if not several(law) and not several(restitution):
        return _chosen(model, law, restitution, usual)
    laws, values = each("laws", law, count), each("values of restitution", restitution, count)
    return [_chosen(model, *pair, usual) for pair in zip(laws, values, strict=True)]


def several(value: Any) -> bool:
    """Whether a value is one for each world: coefficients in the order of contacts, no batch of worlds can have."""
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def each(what: str, value: Any, count: int) -> list[Any]:
    """Return one value for each world.

    Raises:
        OptionError: there are more or less.
    """
    values = list(value) if several(value) else [value] * count
    if len(values) != count:
        raise OptionError(
            f"{count} worlds need as many {what}, got {len(values)}: give one for each world, or one for all; what "
            "differs from contact to contact is in a law, such as Newton([0.4, 0.5])"
        )
    return values


def _chosen(model: mujoco.MjModel, law: Any, restitution: Any, usual: float | None) -> Asked:
    try:
        return Asked(law, choose_law(model, law, restitution))
    except RestitutionError:
        if restitution is not None or usual is None or not isinstance(law, str):
            raise
        return Asked(law, choose_law(model, law, usual))
