"""Tolerances and limits of the scheme."""

from __future__ import annotations

import mujoco

REST_SPEED = 1e-3
"""Closing speed, m/s or rad/s, up to which a contact does not collide; forces within a step can raise it."""

RESOLVED = 0.05
"""Closing speed, m/s or rad/s, from which a contact always collides."""

SHORTFALL_LIMIT = 1e-6
"""Part of the largest contact velocity of a step by which the step may miss the law without being counted."""

MANY_ROUNDS = 24
"""Number of rounds of the slower solvers, if Newton's method fails."""
FEW_ROUNDS = 1
"""The same if the slower solvers have failed in the last step, too."""
SETS = 3
"""Largest number of working sets; each adds the contacts that the velocity after a collision closes."""
PHASE_SETS = 8
"""Number of further working sets if collisions are one after another: each of them can close another contact."""
PHASE_SET_ROWS = 50
"""Largest number of rows of a contact problem that then gets a further working set."""
LAW_WORK = 200.0
"""Units of `work.Work` in a step for what a law with its own rule for friction, such as Poisson's, asks of contacts."""
PHASES = 64
"""Largest number of collisions one after another within a step, for contacts hit through others across open gaps."""
WIDER_DETECTIONS = 8
"""Largest number of detections of contacts farther away: each collision one after another can throw another body."""
CALM_TIES = 1e-2
"""Part of the fastest collision up to which a connect or weld can keep its velocity in the collision.

It is less than for other ways to step (`scene.equality_constraints`), since here the same problem also includes forces.
Couplings of joints and of tendons, which do not tie bodies to each other in a point, have the same limit as there.
"""
STIFF = 1e-5
"""Part of their compliance that equality constraints retain in a collision."""
DRIVEN = 1e-2
"""Part of the energy of a collision's fastest contact that equality constraints may add by their drift.

It holds for each row of a connect or weld, and for all constraints of an island together, see
`problem.solution.driving_equalities`.
"""
SLOWEST = 1e-2
"""Smallest velocity with which shortfalls are compared, m/s."""
SHARES = 0.5, 0.4, 0.0
"""Factors by which margins are reduced, one after another, if there are too many contacts.

With the first one they are as large as the travel of bodies in a step, see `SLACK`.
"""
LEAST = 1e-5
"""Least reach of detection, m or rad, with which closed contacts of bodies at rest are found."""
SLACK = 2.0
"""Ratio of the reach to the travel of a body in a step: more finds contacts in vain, less needs more detections."""
ALWAYS = 1e6
"""Margin, m or rad, with which all limits are found."""
HUGE = mujoco.mjMAXVAL
"""MuJoCo treats larger numbers as a mistake."""


def is_met(missed: float, fastest: float) -> bool:
    """Return whether a velocity by which a step misses the law is negligible next to the largest contact velocity."""
    return missed <= SHORTFALL_LIMIT * max(SLOWEST, fastest)
