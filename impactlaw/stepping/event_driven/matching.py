"""Which contacts at the end of a flow are those at its start."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.contacts import Contacts, gap_gradients
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import Phase, PhaseEnd
from impactlaw.stepping.event_driven.travel import Frames

_SAME_POINT = 1e3  # gap tolerances that a contact point may move more than the geoms
_LAST = 1e9  # m: puts contacts that separate behind those that do not


def match(model: mujoco.MjModel, data: mujoco.MjData, contact_set: ContactSet, phase: Phase) -> np.ndarray:
    """Return for each contact at the end of a flow the index of the same contact at its start, or -1, int (h,).

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    If the two never have more than one contact, it is the same one anyway. If they touch somewhere in common faces, it
    continues the nearest contact that was closed if, at the start, it approached no faster than the flow has changed
    its velocity (an impact so slow is over within the flow), or if the flow is known to be smooth.
    """
    before, now = phase.start.contact_set.pattern, contact_set.pattern
    if not before or not now:
        return np.full(len(now), -1)
    if before.all_single and now.all_single:
        if before is now:
            return now.index
        index = np.minimum(np.searchsorted(before.key, now.key), len(before) - 1)
        return np.where(before.key[index] == now.key, index, -1)
    if before is now:
        moved = contact_set.contacts.position - phase.start.contact_set.contacts.position
        same = _SAME_POINT * phase.tolerance
        if np.abs(moved - moved[0]).max() <= same and _translates(data, contact_set, phase, moved[0], same):
            return now.index
    if before.distinct and now.distinct:
        index = np.minimum(np.searchsorted(before.key, now.key), len(before) - 1)
        same = before.key[index] == now.key
        moved = contact_set.contacts.position - phase.start.contact_set.contacts.position[index]
        travel = phase.travel.between(phase.start.contact_set.frames, data)[now.geoms].sum(axis=1)
        allowed = travel + _SAME_POINT * phase.tolerance
        if np.count_nonzero(same & (np.vecdot(moved, moved) > allowed * allowed)) == 0:
            return np.where(same, index, -1)
    return _match_points(model, data, contact_set, phase)


def refound(known: np.ndarray, held: np.ndarray, contact_set: ContactSet, phase: Phase) -> np.ndarray:
    """Return indices as in `match` in which no contact that is held is missing where one in common faces may be it.

    A correction of position can move a contact point further than the bodies, as on the rim of a coin.
    """
    found = set(known.tolist())
    missing = [index for index in held.tolist() if index >= 0 and index not in found]
    if not missing:
        return known
    start, known = phase.start.contact_set, known.copy()
    for lost in missing:
        new = np.flatnonzero(
            (known < 0) & contact_set.pattern.rolling & (contact_set.pattern.key == start.pattern.key[lost])
        )
        if len(new):
            away = np.linalg.norm(contact_set.contacts.position[new] - start.contacts.position[lost], axis=1)
            known[new[away.argmin()]] = lost
    return known


def continued(phase_end: PhaseEnd, phase: Phase, deepest: int, gap: float) -> tuple[float, float] | None:
    """Return how a contact has come to its gap if it continues one that was elsewhere in common faces.

    That one was closed and did not separate, or so slowly that its rebound rises less than the gap tolerance.

    Args:
        phase_end: the contacts at the end of the flow.
        phase: what led there.
        deepest: index of the contact.
        gap: its gap, m.

    Returns:
        Where its velocity alone leads in half of the flow, and the part of the gap that is bent, m; or None.
    """
    start, contact_set, tau = phase.start, phase_end.now.contact_set, phase.duration
    if phase_end.known[deepest] >= 0 or not contact_set.pattern.vague[deepest]:
        return None
    velocity = start.contact_velocity
    bent = gap - start.gap - velocity * tau
    held = velocity <= start.rounding
    if contact_set.pattern.rolling[deepest]:
        held |= (velocity * tau) ** 2 <= -4.0 * bent * phase.tolerance
    held &= start.closed & (start.contact_set.pattern.key == contact_set.pattern.key[deepest])
    if not np.count_nonzero(held):
        return None
    one = int(np.flatnonzero(held)[velocity[held].argmin()])
    return float(start.gap[one] + 0.5 * velocity[one] * tau), float(bent[one])


def _translates(data: mujoco.MjData, contact_set: ContactSet, phase: Phase, moved: np.ndarray, same: float) -> bool:
    """Return whether the first contact point, midway between two surfaces, has moved as they have on the average."""
    geoms = contact_set.contacts.geoms[0]
    first, second = data.geom_xpos[geoms] - phase.start.contact_set.frames.position[geoms]
    return bool(np.abs(moved - 0.5 * (first + second)).max() <= same)


def _match_points(model: mujoco.MjModel, data: mujoco.MjData, contact_set: ContactSet, phase: Phase) -> np.ndarray:
    start, contacts = phase.start, contact_set.contacts
    before = start.contact_set.contacts
    index = np.full(len(contacts), -1)
    other = contact_set.pattern.key[:, None] != start.contact_set.pattern.key
    moved = np.where(other, np.inf, _moved(contacts, before, start.contact_set.frames, data))
    nearest = moved.argmin(axis=1)
    least = moved[np.arange(len(contacts)), nearest]
    travel = phase.travel.between(start.contact_set.frames, data)
    near = least <= 2.0 * travel[contacts.geoms].sum(axis=1) + _SAME_POINT * phase.tolerance
    near |= np.isfinite(least) & contact_set.pattern.single
    index[near] = nearest[near]
    moved[:, ~start.closed] = np.inf
    moved[:, start.contact_velocity > start.rounding] += np.where(contact_set.pattern.rolling, _LAST, np.inf)[:, None]
    vague = np.flatnonzero(~near & np.isfinite(moved).any(axis=1) & contact_set.pattern.vague)
    if len(vague) and not phase.smooth:
        J = gap_gradients(model, data, contacts.select(vague))
        velocity, change = J @ start.velocity, J @ (data.qvel - start.velocity)
        if contact_set.drift is not None:
            velocity = velocity + contact_set.drift[vague]
        vague = vague[-velocity <= np.abs(change) + start.rounding.max()]
    index[vague] = moved[vague].argmin(axis=1)
    return index


def runs_on(half: PhaseEnd, end: PhaseEnd, phase: Phase, deepest: int) -> bool:
    """Return whether a contact at the end is one that is held after half of the flow, and has run on as before.

    That is ``|p(tau) - p(tau / 2)| <= 2 |p(tau / 2) - p(0)|`` for the contact point p, m; another edge is further away.

    Args:
        half: the contacts after half of the flow.
        end: the contacts at its end.
        phase: what led to the end.
        deepest: index of the contact at the end.
    """
    pattern = end.now.contact_set.pattern
    held = np.flatnonzero(half.sustained & (half.now.contact_set.pattern.key == pattern.key[deepest]))
    if not pattern.rolling[deepest] or len(held) != 1 or half.known[held[0]] < 0:
        return False
    start = phase.start.contact_set.contacts.position[half.known[held[0]]]
    middle, now = half.now.contact_set.contacts.position[held[0]], end.now.contact_set.contacts.position[deepest]
    return bool(np.linalg.norm(now - middle) <= 2.0 * np.linalg.norm(middle - start))


def _moved(contacts: Contacts, before: Contacts, frames: Frames, data: mujoco.MjData) -> np.ndarray:
    """Distances of contact points from earlier ones, seen from that of the two geoms for which they are smaller."""
    distances = []
    for geom, geom_before in zip(contacts.geoms.T, before.geoms.T, strict=True):
        turn = data.geom_xmat[geom].reshape(-1, 3, 3)
        now = np.einsum("hij,hi->hj", turn, contacts.position - data.geom_xpos[geom])
        then = np.einsum(
            "hij,hi->hj", frames.rotation[geom_before].reshape(-1, 3, 3), before.position - frames.position[geom_before]
        )
        distances.append(np.linalg.norm(now[:, None] - then, axis=2))
    return np.minimum(*distances)
