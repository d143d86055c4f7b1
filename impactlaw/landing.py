"""Which contacts that close in a flow are to be held there, not met by a collision of their own."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.flown import Flight

_COUPLED = 1e-12  # cosine in the kinetic metric below which contacts do not act on each other


def landing_pairs(model: mujoco.MjModel, data: mujoco.MjData, end: Flight, timestep: float) -> np.ndarray | None:
    """Return which contacts of the start are of pairs that close slowly beside held ones, bool (h,); None if none are.

    A flow drives the contacts that it holds into each other, at ``-J v`` before they are held: the velocity that its
    discretization cannot tell from zero. A pair whose contacts close no faster than a timestep drives one that acts on
    them (``J_i M^-1 J_j^T != 0``) rattles; its order of collisions means nothing. Only pairs that can touch in several
    points count: what bounces on a single one, as a ball does, has a law to follow down to its rest; and only contacts
    that were near at the start.

    Args:
        model: the scene.
        data: at the end of the flight.
        end: how the flow has ended.
        timestep: of the scene, s.
    """
    if end.free is None:
        return None
    now, known, sustained = end.arrival
    new = np.flatnonzero((now.gap < -end.flow.tolerance) & ~sustained & ~now.touch.pattern.single)
    if not len(new):
        return None
    _, Y, lengths = now.touch.whitened(model, data)
    coupled = np.abs(Y[new] @ Y[sustained].T) > _COUPLED * np.outer(lengths[new], lengths[sustained])
    driven = np.maximum(-now.touch.contact_velocity(end.free)[sustained], 0.0)
    made = np.where(coupled, driven, 0.0).max(axis=1, initial=0.0) * (timestep / end.duration)
    key, fast = now.touch.pattern.key[new], (now.contact_velocity[new] < -made) | (known[new] < 0)
    slow = np.setdiff1d(key[~fast], key[fast])
    return np.isin(end.flow.start.touch.pattern.key, slow) if len(slow) else None
