"""What a stepper reports of a collision."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import Contacts


@dataclass(frozen=True, eq=False)
class ImpactEvent:
    """One collision during a step.

    Attributes:
        time: simulation time of the collision, s.
        contacts: the contacts that collided: labels, geoms, gaps, positions, normals.
        impact: the outcome; ``impact.collision`` holds mass matrix, Jacobian and velocity before.
        qpos: the configuration it happened at, (nq,).
    """

    time: float
    contacts: Contacts
    impact: Impact
    qpos: np.ndarray = field(default_factory=lambda: np.zeros(0))
