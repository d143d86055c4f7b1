"""Compiled solver of contact problems with friction, in cones scaled by their coefficients of friction.

Nothing is compiled here: that is done where `solve` and `retry` are imported.
"""

from impactlaw.solvers.cones.algebra.structure import BILATERAL, BOX, CONE

__all__ = ["BILATERAL", "BOX", "CONE"]
