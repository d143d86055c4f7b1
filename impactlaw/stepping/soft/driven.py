"""Collisions that draw their energy out of what gives way, or out of surfaces between which bodies jam."""

from __future__ import annotations

import math

import numpy as np

from impactlaw.mechanics.impact import Impact
from impactlaw.stepping.soft.tolerances import DRAGGED, GAINED


def is_driven(impact: Impact) -> bool:
    """Return whether constraints that give way have driven bodies into each other: a part of the energy is theirs."""
    constraints = impact.collision.bilateral_jacobian
    return constraints is not None and impact.energy_change > 0.5 * GAINED * impact.intensity**2


def is_dragged(impact: Impact, mass: float) -> bool:
    """Return whether surfaces that move against each other have thrown what jams between them.

    In the frame of one moving surface a collision creates no energy, so that it makes a mass m, which follows it with
    w, no faster than ``|v+| <= |v-| + 2 w sqrt(m)``. Out of a jam between two, as between a belt and a deck that
    rests, any energy can come.

    Args:
        impact: the collision.
        mass: of all bodies that move, kg.
    """
    collision, friction = impact.collision, impact.collision.friction
    rows = [(collision.jacobian, collision.surface_velocity, collision.post_surface_velocity)]
    if friction is not None:
        rows.append((friction.jacobian, friction.surface_velocity, friction.post_surface_velocity))
    fastest = turned = 0.0
    for jacobian, before, after in rows:
        if before is None:
            continue
        w = np.maximum(np.abs(before), np.abs(before if after is None else after))
        whitened = collision.metric.whiten_gradients(np.asarray(jacobian)[w > 0.0])
        square = np.vecdot(whitened, whitened)
        fastest = max(fastest, w.max(initial=0.0))
        turned += float((w[w > 0.0][square > 0.0] ** 2 / square[square > 0.0]).sum())
    if not fastest:
        return False
    followed = max(fastest * math.sqrt(mass), math.sqrt(turned))
    after = math.sqrt(max(0.0, collision.pre_speed**2 + 2.0 * impact.energy_change))
    return after > DRAGGED * (collision.pre_speed + 2.0 * followed)
