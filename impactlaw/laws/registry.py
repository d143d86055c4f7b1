"""Laws by name, for gym.make, the command line and sweeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws.base import Law
from impactlaw.laws.fremond import Fremond, Reversal
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.moreau import Moreau
from impactlaw.laws.newton import Newton
from impactlaw.laws.poisson import Poisson
from impactlaw.laws.portable import restored

REGISTERED: tuple[type[Law], ...] = (MaximalDissipation, Moreau, Newton, Poisson, Fremond, Reversal)
"""A new law is one file, with its name and description on the class, and its class here."""

LAWS: dict[str, Callable[[Any], Law]] = {law.name: law.of for law in REGISTERED}
"""Functions from a restitution to a law, by the name of the law."""

DESCRIPTIONS: dict[str, str] = {law.name: law.description for law in REGISTERED}
"""One line per law."""


def make_law(name: str | Law | Mapping, restitution: Any = None) -> Law:
    """Return the law of that name.

    Args:
        name: "maximal-dissipation", "moreau", "newton", "poisson", "fremond" or "reversal"; a `Law` is returned as is,
            and made again from what `impactlaw.laws.portable` has written down.
        restitution: what the law takes: a coefficient (moreau, reversal), one or several or keyed ones, numbers or
            functions of speed (newton, poisson), a matrix or a keyed one (fremond), nothing (maximal-dissipation).

    Raises:
        UnknownNameError: no such law; the message names the nearest ones.
        RestitutionError: the restitution is missing, superfluous or not in range.
    """
    name, restitution = restored(name), restored(restitution)
    if isinstance(name, Law):
        if restitution is not None:
            raise RestitutionError(f"{name!r} already has its restitution; leave restitution={restitution!r} out")
        return name
    if not isinstance(name, str) or name not in LAWS:
        raise UnknownNameError("law", name, LAWS)
    return LAWS[name](restitution)
