"""The numbers of the scheme."""

from __future__ import annotations

import mujoco

REST_SPEED = 1e-3
"""Closing speed, m/s or rad/s, up to which a contact does not collide, if forces are not faster within a step."""

RESOLVED = 0.05
"""Closing speed, m/s or rad/s, from which a contact always collides."""

SHORTFALL_LIMIT = 1e-6
"""Part of the largest contact velocity of a step by which a step may miss its law without being counted."""

MANY_ROUNDS = 24
"""Rounds of the slower solvers, where Newton's method fails."""
FEW_ROUNDS = 1
"""Rounds of these where they have failed in the step before, too."""
LOOKS = 3
"""Looks at contacts at most, for those that the velocity after a collision closes."""
PHASE_LOOKS = 8
"""Looks beyond these, where collisions are one after another: each of them can close another contact."""
PHASE_LOOK_ROWS = 50
"""Rows of a contact problem up to which that is looked at again."""
PHASES = 64
"""Collisions one after another within a step at most, where contacts are hit through others across open gaps."""
FARTHER_LOOKS = 8
"""Times at most that a step looks farther for contacts: each collision one after another can throw another body."""
CALM_TIES = 1e-2
"""Part of the fastest collision up to which the velocity of a connect or weld is one that it can keep there.

It is less than that of other ways to step (`scene.equality_constraints`): here one problem has forces in it, too.
Couplings of joints and of tendons, which tie no bodies to each other in a point, keep as much as there."""
STIFF = 1e-5
"""Part of their compliance that equality constraints keep in a collision."""
DRIVEN = 1e-2
"""Part of the energy of the fastest contact of a collision that equality constraints may add by their drift.

It is for each row of a connect or weld, and for all of an island together, see `problem.solution.driven`."""
SLOWEST = 1e-2
"""Velocity below which shortfalls are compared with this, m/s."""
SHARES = 0.2, 0.0
"""What is left of margins where there are too many contacts."""
HUGE = mujoco.mjMAXVAL
"""MuJoCo takes larger numbers for a mistake."""


def is_met(missed: float, fastest: float) -> bool:
    """Return whether a step that misses its law by a velocity meets it, next to the largest contact velocity."""
    return missed <= SHORTFALL_LIMIT * max(SLOWEST, fastest)
