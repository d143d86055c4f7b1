"""The law and the options of soft steps in the form of compiled code."""

from __future__ import annotations

import numpy as np

from impactlaw.laws import Coulomb, Law
from impactlaw.stepping.compiled import law_table
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.law_targets import LawTargets
from impactlaw.stepping.soft.scheme import SoftStepping


def reason(scheme: SoftStepping) -> str | None:
    """Return the reason why a scheme steps in Python under its law; None if compiled code can take the steps."""
    return scheme.only_in_python or law_table.reason(LawTargets(scheme.collisions.collider.law))


def coefficients(scheme: SoftStepping) -> Coefficients:
    """Return a table for the law's coefficients, which is still empty."""
    targets, collisions = LawTargets(scheme.collisions.collider.law), scheme.collisions
    return Coefficients(targets, collisions.names, collisions.limits, scheme.model.njnt)


def settings(scheme: SoftStepping) -> tuple[float, ...]:
    """Return the other options in the form of compiled code, see `world.Settings`."""
    collider = scheme.collisions.collider
    e = LawTargets(collider.law).restitution
    return (
        np.nan if e is None else e,
        collider.law.tangential_restitution if isinstance(collider.law, Coulomb) else 0.0,
        float(_is_exact(collider.law)),
        float(_is_exact(collider.last_law)),
        scheme.collisions.rest_speed,
        float(collider.most),
    )


def _is_exact(law: Law) -> bool:
    """Return whether friction, if there is any, is exact Coulomb friction."""
    return not isinstance(law, Coulomb) or law.cone == "exact"
