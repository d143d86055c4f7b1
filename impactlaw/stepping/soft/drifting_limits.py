"""Limits that close because equality constraints drift, not by a motion that the constraints allow."""

from __future__ import annotations

import numpy as np

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.equality_constraints import CALM, DRIFT, HELD_BY_DRIFT


def drifting(metric: KineticMetric, gradients: np.ndarray, constraints: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return which gaps close because equality constraints drift, bool (h,).

    The constraints leave only a small remainder of the gradient of such a gap. To open the gap, the motion that they
    allow would have to make up for the drift, divided by this remainder. A drift that is negligible next to the
    velocities of the contacts that this motion reaches does not count: there the limit is at rest, and stops the bodies
    that load it.

    Args:
        metric: the kinetic metric.
        gradients: gap gradients, (h, nv).
        constraints: gradients of the constraints that keep their velocity, (m, nv).
        velocity: the velocity before the collision, (nv,).
    """
    whitened, at = metric.whiten_gradients(gradients), metric.whiten(velocity)
    left = Bilateral.of(metric.whiten_gradients(constraints)).project(whitened)
    size, before, allowed = np.linalg.norm(left, axis=1), np.linalg.norm(whitened, axis=1), left @ at
    found = (size > 0.0) & (size <= HELD_BY_DRIFT * before)
    for i in np.flatnonzero(found):
        reached = np.abs(left @ left[i]) > INFLUENCE * size * size[i]
        fastest = (np.abs(allowed[reached]) / size[reached]).max(initial=0.0)
        found[i] = abs(whitened[i] @ at - allowed[i]) > max(CALM * abs(allowed[i]), DRIFT * size[i] * fastest)
    return found
