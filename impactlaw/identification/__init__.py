"""Identification of laws from measured collisions: read them, audit them, fit a family of laws, cross-validate it."""

from impactlaw.identification.auditing import Audit, Cause, audit
from impactlaw.identification.families import FAMILIES
from impactlaw.identification.fitting import CrossValidation, Identified, cross_validate, fit
from impactlaw.identification.reading import Collisions, read_collisions

__all__ = [
    "FAMILIES", "Audit", "Cause", "Collisions", "CrossValidation", "Identified", "audit", "cross_validate", "fit",
    "read_collisions",
]  # fmt: skip
