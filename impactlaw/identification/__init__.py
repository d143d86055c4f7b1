"""Laws from measurements: read collisions, audit them, fit a family of laws, and see how it predicts."""

from impactlaw.identification.auditing import Audit, Cause, audit
from impactlaw.identification.families import FAMILIES
from impactlaw.identification.fitting import CrossValidation, Identified, cross_validate, fit
from impactlaw.identification.reading import Collisions, read_collisions

__all__ = [
    "FAMILIES", "Audit", "Cause", "Collisions", "CrossValidation", "Identified", "audit", "cross_validate", "fit",
    "read_collisions",
]  # fmt: skip
