"""The table of laws by name, for gym.make, the command line and sweeps."""

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
"""The laws that have a name. To add one, write its class, with name and description, in a new file and list it here."""

LAWS: dict[str, Callable[[Any], Law]] = {law.name: law.of for law in REGISTERED}
"""For each name the function that makes the law from a restitution."""

DESCRIPTIONS: dict[str, str] = {law.name: law.description for law in REGISTERED}
"""One line per law."""


def make_law(name: str | Path | Law | Mapping, restitution: Any = None) -> Law:
    """Return the law of that name.

    Args:
        name: "maximal-dissipation", "moreau", "newton", "poisson", "fremond", "reversal", "routh", "compliant" or
            "any-outcome"; or a `Law`, which is returned unchanged; or a mapping made by `portable`, or the path of a
            ``.json`` file with one, such as the ``law.json`` of `impactlaw identify`.
        restitution: the restitution of the law: one coefficient (moreau, reversal, compliant); one coefficient, several
            or keyed ones, each a number or a function of speed (newton, poisson, routh); a matrix, plain or keyed
            (fremond); None (maximal-dissipation, any-outcome).

    Raises:
        UnknownNameError: no law has this name; the message suggests the nearest ones.
        RestitutionError: the restitution is missing, superfluous or out of range; or the file does not hold a law.
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
    """Return whether a law takes a restitution: a `Law`, which has its own, does not, and neither do some names."""
    if isinstance(restored(law), Law):
        return False
    if not isinstance(law, str) or law not in LAWS:
        raise UnknownNameError("law", law, LAWS)
    return next(kind for kind in REGISTERED if kind.name == law).takes_restitution


def _read(path: Path) -> Law:
    """Read a law from a JSON file."""
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
