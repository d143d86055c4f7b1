"""Exact, chosen multi-contact impact laws for MuJoCo scenes, after Aeberhard and Glocker."""

from impactlaw.admissible import AdmissibleSet
from impactlaw.collision import Collision
from impactlaw.contacts import Contacts, read_contacts
from impactlaw.errors import ImpactLawError
from impactlaw.events import ImpactEvent
from impactlaw.friction import Friction
from impactlaw.friction_impact import FrictionImpact
from impactlaw.impact import Impact, Violations
from impactlaw.laws import (
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
from impactlaw.stepper import Stepper

__all__ = [
    "AdmissibleSet",
    "Collision",
    "Compliant",
    "Contacts",
    "Coulomb",
    "Fremond",
    "Friction",
    "FrictionImpact",
    "Impact",
    "ImpactEvent",
    "ImpactLawError",
    "Law",
    "LinearMap",
    "MaximalDissipation",
    "Moreau",
    "Newton",
    "Poisson",
    "Routh",
    "Scattered",
    "Stepper",
    "Violations",
    "energy_gain",
    "make_law",
    "read_contacts",
]
