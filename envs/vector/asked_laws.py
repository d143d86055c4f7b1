"""The laws of worlds as given by arguments: one for all worlds, or one for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.envs.law_distribution import LawDistribution, is_written
from impactlaw.envs.law_options import choose_law
from impactlaw.errors import OptionError, RestitutionError
from impactlaw.laws import Law


class Asked(NamedTuple):
    """The law of a world, and the argument by which it was given."""

    given: Any  # a law, which has its own restitution, or the name of a law, to which a restitution can be given
    law: Law  # the law

    def other(self, model: mujoco.MjModel, options: Mapping[str, Any]) -> Asked:
        """Return the law given by options "law" and "restitution", or by one of them.

        Raises:
            UnknownNameError: there is no such law.
            RestitutionError: the restitution does not fit the law.
        """
        given = options.get("law", self.given)
        return Asked(given, choose_law(model, given, options.get("restitution")))


def asked_laws(
    model: mujoco.MjModel, law: Any, restitution: Any, count: int, *, usual: float | None = None
) -> Asked | list[Asked] | LawDistribution:
    """Return the laws of worlds: one law for all, a list with one law per world, or the given distribution.

    Args:
        model: the model of all worlds.
        law: a law or its name, or a list with one for each world, or a `LawDistribution`.
        restitution: argument of laws given by name, or a list or an array with one for each world; None for the scene's
            own.
        count: number of worlds.
        usual: restitution of a law that needs one, if neither the argument nor the scene gives one.

    Raises:
        OptionError: the number of laws or restitutions is not that of the worlds.
        UnknownNameError: there is no such law.
        RestitutionError: the restitution does not fit a law, or a law has its own.
    """
    if is_written(law):
        law = LawDistribution(**law)
    if isinstance(law, LawDistribution):
        if restitution is not None:
            raise RestitutionError(f"a LawDistribution has its own restitution; leave restitution={restitution!r} out")
        return law
    if not several(law) and not several(restitution):
        return _chosen(model, law, restitution, usual)
    laws, values = each("laws", law, count), each("values of restitution", restitution, count)
    return [_chosen(model, *pair, usual) for pair in zip(laws, values, strict=True)]


def several(value: Any) -> bool:
    """Return whether a value is a sequence of one value per world.

    It cannot be coefficients in the order of contacts, since a batch does not accept laws with these.
    """
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def each(what: str, value: Any, count: int) -> list[Any]:
    """Return a list of one value per world.

    Raises:
        OptionError: a sequence of another length is given.
    """
    values = list(value) if several(value) else [value] * count
    if len(values) != count:
        raise OptionError(
            f"{count} worlds need as many {what}, got {len(values)}: give one for each world, or one for all; what "
            "differs from contact to contact is in a law, such as Newton([0.4, 0.5]), and what is drawn by episode "
            "in a LawDistribution, as law"
        )
    return values


def _chosen(model: mujoco.MjModel, law: Any, restitution: Any, usual: float | None) -> Asked:
    try:
        return Asked(law, choose_law(model, law, restitution))
    except RestitutionError:
        if restitution is not None or usual is None or not isinstance(law, str):
            raise
        return Asked(law, choose_law(model, law, usual))
