"""Compiled solver of contact problems with friction, in cones scaled by their coefficients of friction."""

from impactlaw.solvers.cones.algebra.structure import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.retry import retry
from impactlaw.solvers.cones.solve import natural_map, solve

__all__ = ["BILATERAL", "BOX", "CONE", "natural_map", "retry", "solve"]
