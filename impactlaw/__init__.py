"""Exact, chosen multi-contact impact laws for MuJoCo scenes, after Aeberhard and Glocker."""

from typing import TYPE_CHECKING, Any

from impactlaw import signals as _signals  # noqa: F401  (Ctrl-C, before all that takes long to import)

# isort: split
from impactlaw.errors import ImpactLawError
from impactlaw.laws import (
    AnyOutcome,
    Compliant,
    Coulomb,
    Fremond,
    Law,
    LinearMap,
    MaximalDissipation,
    Moreau,
    Newton,
    Poisson,
    Routh,
    Scattered,
    energy_gain,
    make_law,
)
from impactlaw.mechanics.admissible.admissible_set import AdmissibleSet
from impactlaw.mechanics.admissible.violations import Violations
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import Contacts
from impactlaw.scene.read import read_contacts
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.stepper import Stepper

if TYPE_CHECKING:
    from impactlaw.batch import Batch as Batch

__all__ = [
    "AdmissibleSet", "AnyOutcome", "Collision", "Compliant", "Contacts", "Coulomb", "Fremond", "Friction",
    "FrictionImpact", "Impact", "ImpactEvent", "ImpactLawError", "Law", "LinearMap", "MaximalDissipation", "Moreau",
    "Newton", "Poisson", "Routh", "Scattered", "Stepper", "Violations", "energy_gain", "make_law", "read_contacts",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import `Batch` when it is first used: few programs need it, and its import takes long. Look up the version."""
    if name == "Batch":
        from impactlaw.batch import Batch

        return Batch
    if name == "__version__":
        from importlib.metadata import version

        return version("impactlaw")
    raise AttributeError(f"module 'impactlaw' has no attribute {name!r}")
