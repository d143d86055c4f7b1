"""Compiled solver of contact problems with friction, in cones scaled by their coefficients of friction."""

from impactlaw.solvers.cones.solve import natural_map, solve

__all__ = ["natural_map", "solve"]
