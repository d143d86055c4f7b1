"""The laws that worlds are made with: one for all of them, or one for each."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_options import choose_law
from impactlaw.errors import OptionError, RestitutionError
from impactlaw.laws import Law


def asked_laws(
    model: mujoco.MjModel, law: Any, restitution: Any, count: int, *, usual: float | None = None
) -> Law | list[Law] | LawDistribution:
    """Return the law of so many worlds.

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


def _chosen(model: mujoco.MjModel, law: Any, restitution: Any, usual: float | None) -> Law:
    try:
        return choose_law(model, law, restitution)
    except RestitutionError:
        if restitution is not None or usual is None or not isinstance(law, str):
            raise
        return choose_law(model, law, usual)
