"""Limits that close because equality constraints give way, not by a motion that these allow."""

from __future__ import annotations

import numpy as np

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.equality_constraints import CALM, DRIFT, HELD_BY_DRIFT


def drifting(metric: KineticMetric, gradients: np.ndarray, constraints: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return of which gap gradients, (h, nv), constraints, (m, nv), leave little, and give way themselves, bool (h,).

    Such a gap closes because constraints drift, not by a motion that they allow: to open it, that motion would have to
    make up for the drift, divided by the little that is left. A drift that is nothing next to the contacts that this
    motion reaches is not one: there a limit at rest holds what drives it.
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
