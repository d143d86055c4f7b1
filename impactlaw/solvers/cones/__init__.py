"""Compiled solver of contact problems with friction, in cones scaled by their coefficients of friction.

Importing this package compiles no code; importing its modules `solve` and `jams` does.
"""

from impactlaw.solvers.cones.algebra.structure import BILATERAL, BOX, CONE

__all__ = ["BILATERAL", "BOX", "CONE"]
