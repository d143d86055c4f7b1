"""Exact, chosen multi-contact impact laws for MuJoCo scenes, after Aeberhard and Glocker."""

from impactlaw.admissible import AdmissibleSet
from impactlaw.collision import Collision
from impactlaw.errors import ImpactLawError
from impactlaw.impact import Impact, Violations
from impactlaw.laws import Fremond, Law, LinearMap, MaximalDissipation, Moreau, Newton, energy_gain, make_law

__all__ = [
    "AdmissibleSet",
    "Collision",
    "Fremond",
    "Impact",
    "ImpactLawError",
    "Law",
    "LinearMap",
    "MaximalDissipation",
    "Moreau",
    "Newton",
    "Violations",
    "energy_gain",
    "make_law",
]
