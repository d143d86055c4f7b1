"""Laws by name, for gym.make, the command line and sweeps."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws.base import Law
from impactlaw.laws.compliant import Compliant
from impactlaw.laws.drawn.any_outcome import AnyOutcome
from impactlaw.laws.fremond import Fremond, Reversal
from impactlaw.laws.friction.routh import Routh
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.moreau import Moreau
from impactlaw.laws.newton import Newton
from impactlaw.laws.poisson import Poisson
from impactlaw.laws.restitution.portable import restored

REGISTERED: tuple[type[Law], ...] = (
    MaximalDissipation, Moreau, Newton, Poisson, Fremond, Reversal, Routh, Compliant, AnyOutcome,
)  # fmt: skip
"""A new law is one file, with its name and description on the class, and its class here."""

LAWS: dict[str, Callable[[Any], Law]] = {law.name: law.of for law in REGISTERED}
"""Functions from a restitution to a law, by the name of the law."""

DESCRIPTIONS: dict[str, str] = {law.name: law.description for law in REGISTERED}
"""One line per law."""


def make_law(name: str | Path | Law | Mapping, restitution: Any = None) -> Law:
    """Return the law of that name.

    Args:
        name: "maximal-dissipation", "moreau", "newton", "poisson", "fremond", "reversal", "routh", "compliant" or
            "any-outcome"; a `Law` is returned as is, and made again from what `portable` has written down, or from a
            file of that, ``law.json``, as `impactlaw identify` writes it.
        restitution: what the law takes: a coefficient (moreau, reversal, compliant), one or several or keyed ones,
            numbers or functions of speed (newton, poisson, routh), a matrix or a keyed one (fremond), nothing
            (maximal-dissipation, any-outcome).

    Raises:
        UnknownNameError: no such law; the message names the nearest ones.
        RestitutionError: the restitution is missing, superfluous or not in range; or a file is not one of a law.
    """
    if isinstance(name, Path) or (isinstance(name, str) and name.endswith(".json")):
        name = _read(Path(name))
    name, restitution = restored(name), restored(restitution)
    if isinstance(name, Law):
        if restitution is not None:
            raise RestitutionError(f"{name!r} already has its restitution; leave restitution={restitution!r} out")
        return name
    if isinstance(name, Mapping):
        raise RestitutionError(
            f"a mapping that is a law is one that impactlaw.laws.portable has made, got {dict(name)!r:.100}; pass the "
            "name of a law, and its restitution"
        )
    if not isinstance(name, str) or name not in LAWS:
        raise UnknownNameError("law", name, LAWS)
    return LAWS[name](restitution)


def takes_restitution(law: str | Law | Mapping) -> bool:
    """Return whether a restitution goes with a law: not with a `Law`, which has its own, and not with some names."""
    if isinstance(restored(law), Law):
        return False
    if not isinstance(law, str) or law not in LAWS:
        raise UnknownNameError("law", law, LAWS)
    return next(kind for kind in REGISTERED if kind.name == law).takes_restitution


def _read(path: Path) -> Law:
    """Return the law that a file holds."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RestitutionError(f"cannot read a law from {path}: {error.strerror}") from None
    except ValueError as error:
        raise RestitutionError(f"{path} is not JSON: {error}") from None
    law = restored(value.get("law", value)) if isinstance(value, Mapping) else None
    if not isinstance(law, Law):
        raise RestitutionError(f"{path} holds no law, as `impactlaw identify` writes it")
    return law
