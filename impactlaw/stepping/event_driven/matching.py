"""Match the contacts at the end of a smooth phase with those at its start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.scene.contacts import gap_gradients
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import ContactState, Phase, PhaseEnd

_SAME_POINT = 1e3  # distance that a contact point may move beyond the motion of the geoms, in gap tolerances
_SMOOTH = 0.1  # largest deviation of a smooth gap from a quarter of its bend halfway, relative to the bend
_LAST = 1e9  # m: sorts contacts that separate behind the others


class Matched(NamedTuple):
    """Contacts that were looked at, and which contacts at the start they continue, int (h,), or -1."""

    now: ContactState
    known: np.ndarray

    def continues(self, held: np.ndarray) -> bool:
        """Return whether all given contacts at the start, indices, are continued, on common faces by one contact each.

        Both rims of a foil are next to each other, and only one of them can be the contact that was held.
        """
        if not set(held.tolist()).issubset(self.known.tolist()):
            return False
        vague = self.now.pattern.vague
        if not np.count_nonzero(vague):
            return True
        again = self.known[vague & among(self.known, held)]
        return len(np.unique(again)) == len(again)


class Continued(NamedTuple):
    """The change of a gap of a contact that continues another one."""

    begun: float  # gap at the start of the phase, m
    led: float  # change of the gap in the phase at the velocity of the start, m
    gap: float  # gap at the end, m

    def is_smooth(self, half: float) -> bool:
        """Return whether the gap, ``half`` m halfway, has bent as that of a smooth surface does, like ``t^2``."""
        bent = self.gap - self.begun - self.led
        return abs(half - self.begun - 0.5 * self.led - 0.25 * bent) <= _SMOOTH * abs(bent)

    def to_half(self, half: float) -> Continued:
        """Return the change of the gap in the first half of the phase, at the end of which it was ``half``, m."""
        return Continued(self.begun, 0.5 * self.led, half)


def match(contact_set: ContactSet, phase: Phase) -> np.ndarray:
    """Return for each contact at the end of a phase the index of the same contact at its start, or -1, int (h,).

    The same contact is between the same two geoms, and its point, seen from one of them, has moved no further than they
    have traveled. If the two geoms never have more than one contact, it is the same contact in any case. If they touch
    anywhere in common faces, the contact continues the nearest closed contact under one of two conditions: the phase is
    known to be smooth, or that contact approached at the start no faster than the phase has changed the contact's
    velocity (so slow an impact is over within the phase), and was not thrown open there.
    """
    before, now = phase.start.pattern, contact_set.pattern
    if before is now and now.all_single:
        return np.arange(len(now))
    if not before or not now:
        return np.full(len(now), -1)
    if not (before.all_single and now.all_single):
        return _match_points(contact_set, phase)
    index = np.minimum(before.key.searchsorted(now.key), len(before) - 1)
    return np.where(before.key[index] == now.key, index, -1)


def among(index: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Return which indices of contacts are among the others, where -1 is no contact, bool (h,)."""
    return (index[:, None] == some[some >= 0]).any(axis=1)


def refound(known: np.ndarray, held: np.ndarray, contact_set: ContactSet, phase: Phase) -> np.ndarray:
    """Return the indices of `match`, with missing held contacts assigned to contacts on a rim of the same geoms.

    A correction of position can move a contact point further than the bodies, as on the rim of a coin.
    """
    found = set(known.tolist())
    missing = [index for index in held.tolist() if index >= 0 and index not in found]
    if not missing:
        return known
    start, pattern, known = phase.start, contact_set.pattern, known.copy()
    for lost in missing:
        new = np.flatnonzero((known < 0) & pattern.rolling & (pattern.key == start.pattern.key[lost]))
        if len(new):
            away = np.linalg.norm(contact_set.contacts.position[new] - start.contacts.position[lost], axis=1)
            known[new[away.argmin()]] = lost
    return known


def kept_on_faces(found: Matched, before: Matched, held: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the indices of contacts after a correction of position: those on common faces go on as before it.

    Bodies that lie flat on each other have other points of contact after a correction by a nanometer, among them some
    that were open by as little at the start of the phase. If those were no longer held, the position would be held by
    more contacts than the velocity, and energy would be gained. A point therefore continues what the nearest point of
    the same faces did, if that is a held contact.
    """
    (now, known), last = found, before.now
    if not np.count_nonzero(now.pattern.vague):
        return known
    known = known.copy()
    near = now.gap <= _SAME_POINT * tolerance  # others are open, and perhaps not seen before the correction
    for one in np.flatnonzero(now.pattern.vague & near & ~among(known, held)):
        same = np.flatnonzero(last.pattern.key == now.pattern.key[one])
        if len(same):
            away = np.linalg.norm(last.contacts.position[same] - now.contacts.position[one], axis=1)
            nearest = before.known[same[away.argmin()]]
            known[one] = nearest if nearest >= 0 and nearest in held else known[one]
    return known


def continued(phase_end: PhaseEnd, phase: Phase, deepest: int, gap: float) -> Continued | None:
    """Return the change of a gap if a vague contact continues one in another place of common faces; else None.

    That contact was closed and did not separate, or so slowly that its rebound rises less than the gap tolerance. The
    surfaces did not separate faster where they touch now.
    """
    start, pattern, tau = phase.start, phase_end.now.pattern, phase.duration
    velocity, contact_set = start.contact_velocity, phase_end.now.contact_set
    opening = contact_set.contact_velocity(start.velocity)[deepest]
    if _is_thrown(opening, 2.0 * (opening * tau - gap), phase):
        return None
    bent = gap - start.gap - velocity * tau
    held = velocity <= start.rounding
    if pattern.rolling[deepest]:
        held |= (velocity * tau) ** 2 <= -4.0 * bent * phase.tolerance
    held &= start.closed & (start.pattern.key == pattern.key[deepest])
    if not np.count_nonzero(held):
        return None
    one = int(np.flatnonzero(held)[velocity[held].argmin()])
    return Continued(float(start.gap[one]), float(velocity[one] * tau), gap)


def _match_points(contact_set: ContactSet, phase: Phase) -> np.ndarray:
    start, contacts, pattern = phase.start, contact_set.contacts, contact_set.pattern
    model, data = contact_set.configuration.model, contact_set.configuration.data
    away = contact_set.seen[:, None] - start.contact_set.seen
    squares = np.vecdot(away, away)  # the distance counts as seen from the geom for which it is smaller
    moved = np.sqrt(np.minimum(squares[..., 0], squares[..., 1]))
    moved[pattern.key[:, None] != start.pattern.key] = np.inf
    nearest = moved.argmin(axis=1)
    least = moved[np.arange(len(nearest)), nearest]
    travel, geoms = phase.travel.between(start.frames, data), contacts.geoms
    near = least <= 2.0 * (travel[geoms[:, 0]] + travel[geoms[:, 1]]) + _SAME_POINT * phase.tolerance
    if np.count_nonzero(near) == len(near):
        return nearest
    near |= np.isfinite(least) & pattern.single
    index = np.where(near, nearest, -1)
    if near.all():
        return index
    moved[:, ~start.closed] = np.inf
    moved[:, start.contact_velocity > start.rounding] += np.where(pattern.rolling, _LAST, np.inf)[:, None]
    vague = np.flatnonzero(~near & np.isfinite(moved).any(axis=1) & pattern.vague)
    if len(vague) and not phase.smooth:
        J = gap_gradients(model, data, contacts.select(vague))
        velocity, change = J.dot(start.velocity), J.dot(data.qvel - start.velocity)
        if contact_set.drift is not None:
            velocity = velocity + contact_set.drift[vague]
        change = np.abs(change)
        slow = -velocity <= change + start.rounding.max()
        vague = vague[slow & ~_is_thrown(velocity, change * phase.duration, phase)]
    index[vague] = moved[vague].argmin(axis=1)
    return index


def _is_thrown(velocity: np.ndarray, closing: np.ndarray, phase: Phase) -> np.ndarray:
    """Return whether contacts were thrown open by more than the gap tolerance, to close again in the phase.

    Args:
        velocity: contact velocities at the start of the phase, m/s, (k,).
        closing: closing accelerations in the phase, times the square of its duration, m, (k,).
        phase: the phase.
    """
    rise = (velocity * phase.duration) ** 2 > 2.0 * closing * phase.tolerance
    return (velocity > phase.start.rounding.max(initial=0.0)) & rise


def runs_on(half: PhaseEnd, end: PhaseEnd, phase: Phase, deepest: int) -> bool:
    """Return whether a contact at the end is one that was held halfway through the phase, and has run on as before.

    The condition is ``|p(tau) - p(tau / 2)| <= 2 |p(tau / 2) - p(0)|`` for the contact point p, m. Another edge would
    be further away.
    """
    pattern = end.now.pattern
    held = np.flatnonzero(half.sustained & (half.now.pattern.key == pattern.key[deepest]))
    if not pattern.rolling[deepest] or len(held) != 1 or half.known[held[0]] < 0:
        return False
    start = phase.start.contacts.position[half.known[held[0]]]
    middle, now = half.now.contacts.position[held[0]], end.now.contacts.position[deepest]
    return bool(np.linalg.norm(now - middle) <= 2.0 * np.linalg.norm(middle - start))
