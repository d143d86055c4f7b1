"""Laws by name, for gym.make, the command line and sweeps."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws.base import Law
from impactlaw.laws.compliant import Compliant
from impactlaw.laws.fremond import Fremond, Reversal
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.moreau import Moreau
from impactlaw.laws.newton import Newton
from impactlaw.laws.poisson import Poisson
from impactlaw.laws.portable import restored
from impactlaw.laws.routh import Routh


def _maximal_dissipation(restitution: Any) -> Law:
    if restitution is not None and restitution != 0:
        raise RestitutionError(f"law 'maximal-dissipation' has restitution 0, got {restitution!r}; leave it out")
    return MaximalDissipation()


def _moreau(restitution: Any) -> Law:
    return Moreau(_required("moreau", restitution))


def _newton(restitution: Any) -> Law:
    return Newton(_required("newton", restitution))


def _poisson(restitution: Any) -> Law:
    return Poisson(_required("poisson", restitution))


def _fremond(restitution: Any) -> Law:
    if restitution is not None and not isinstance(restitution, Mapping) and np.ndim(restitution) == 0:
        raise RestitutionError("law 'fremond' needs a restitution matrix; 'reversal' takes a single coefficient")
    return Fremond(_required("fremond", restitution))


def _routh(restitution: Any) -> Law:
    return Routh(_required("routh", restitution))


def _compliant(restitution: Any) -> Law:
    return Compliant(1.0) if restitution is None else Compliant(1.0, restitution=restitution)


def _reversal(restitution: Any) -> Law:
    return Reversal() if restitution is None else Reversal(restitution)


LAWS: dict[str, Callable[[Any], Law]] = {
    "maximal-dissipation": _maximal_dissipation,
    "moreau": _moreau,
    "newton": _newton,
    "poisson": _poisson,
    "fremond": _fremond,
    "reversal": _reversal,
    "routh": _routh,
    "compliant": _compliant,
}
"""The registry: a new law is one file and one line here."""

DESCRIPTIONS: dict[str, str] = {
    "maximal-dissipation": "E = 0: the least kinetic energy that no penetration allows; takes no restitution",
    "moreau": "E = e 1: one coefficient, the half-line from v- through the point of maximal dissipation",
    "newton": "E = diag(e_1 .. e_h): one coefficient per contact, also keyed by contact label or a function of speed",
    "poisson": "compression, then e_i times its impulse for contact i: coefficients as newton's",
    "fremond": "E full: any matrix, also keyed by pairs of contact labels",
    "reversal": "E = e times the anti-identity along the contacts' order: Newton's cradle",
    "routh": "friction at every instant of one contact's impact, then e times the impulse of compression",
    "compliant": "contacts are equal Hertzian springs for a moment, each with restitution e; 1 if not given",
}
"""One line per law of the registry."""


def make_law(name: str | Path | Law | Mapping, restitution: Any = None) -> Law:
    """Return the law of that name.

    Args:
        name: "maximal-dissipation", "moreau", "newton", "poisson", "fremond", "reversal", "routh" or
            "compliant"; a `Law` is returned as is, and made again from what `impactlaw.laws.portable` has written down,
            or from a file of that, ``law.json``, as `impactlaw identify` writes it.
        restitution: what the law takes: a coefficient (moreau, reversal, compliant), one or several or keyed ones,
            numbers or functions of speed (newton, poisson, routh), a matrix or a keyed one (fremond),
            nothing (maximal-dissipation).

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
    if not isinstance(name, str) or name not in LAWS:
        raise UnknownNameError("law", name, LAWS)
    return LAWS[name](restitution)


def _read(path: Path) -> Law:
    """Return the law that a file holds.

    Raises:
        RestitutionError: it holds none.
    """
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


def _required(name: str, restitution: Any) -> Any:
    if restitution is None:
        raise RestitutionError(f"law {name!r} needs a restitution")
    return restitution
