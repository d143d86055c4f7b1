"""A flow that has been flown: what it has shown of the gaps, and when they are expected to close in the next one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState, Phase, PhaseEnd
from impactlaw.stepping.event_driven.gap_functions import Observation, parabola_closes

_SHORTER = 0.1  # part of a flow over which a contact that closes in its end may rest instead
_RESTS = 4.0  # gap tolerances ``v t``, up to which a rebound at v of duration t rises by no more than the tolerance


class TrialStep(NamedTuple):
    """A flow that has been tried: the contacts at its end, and the smallest gap among those that are not held.

    Attributes:
        phase: what has been tried.
        phase_end: the contacts at its end.
        gap: smallest gap among those that are not held, m. A contact that was deeper at the start counts as touching.
        deepest: index of that contact, -1 where none is near.
        further: contacts that are not near.
        keep: what is left to do if the flow is to be kept, see `kept`; None if nothing is.
    """

    phase: Phase
    phase_end: PhaseEnd
    gap: float
    deepest: int
    further: tuple[Observation, ...] = ()
    keep: Callable[[], PhaseEnd] | None = None

    @classmethod
    def of(cls, phase: Phase, phase_end: PhaseEnd, keep: Callable[[], PhaseEnd] | None = None) -> TrialStep:
        """Look at the contacts at the end of a flow, of which some are not held."""
        opened = np.flatnonzero(~phase_end.sustained)
        clear = _clear(phase_end.now.gap[opened], phase_end.known[opened], phase)
        least = int(clear.argmin())
        return cls(phase, phase_end, clear.item(least), opened.item(least), keep=keep)

    def kept(self) -> TrialStep:
        """Return the flight with velocities as they are with contacts held, and bends; data must be at its end."""
        phase_end = self.phase_end if self.keep is None else self.keep()
        now, known, sustained = phase_end
        if np.count_nonzero(sustained) < len(sustained):
            phase_end = PhaseEnd(now.bending(_bend(phase_end, self.phase)), known, sustained)
        return self if phase_end is self.phase_end else self._replace(phase_end=phase_end, keep=None)

    @property
    def duration(self) -> float:
        """Of the flow, s."""
        return self.phase.duration

    @property
    def was_closed(self) -> bool:
        """Whether the deepest contact penetrates and was closed, and no deeper, at the start of the flow."""
        if self.gap >= -self.phase.tolerance:
            return False
        before = self.phase_end.known[self.deepest]
        return bool(before >= 0 and abs(self.phase.start.gap[before]) <= self.phase.tolerance)

    @property
    def observations(self) -> Iterator[Observation]:
        """Contacts that are not held, by their gaps; those that were not near at the start are told by their geoms."""
        now, known, sustained = self.phase_end
        opened = np.flatnonzero(~sustained)
        if not len(opened):
            return iter(self.further)
        known = known[opened]
        contact = np.where(known >= 0, known, -1 - now.contact_set.pattern.key[opened])
        gap = _clear(now.gap[opened], known, self.phase)
        before = now.contact_set.contact_velocity(self.phase.start.velocity)[opened]
        return chain(sighted(contact, gap, now.contact_velocity[opened], before), self.further)


def rests(end: TrialStep, shorter: TrialStep) -> bool:
    """Return whether the contact that closes in the end, closed at the start, stays closed over a shorter flow."""
    before = end.phase_end.known[end.deepest]
    if shorter.gap < -end.phase.tolerance or before < 0 or shorter.duration < _SHORTER * end.duration:
        return False
    return bool(shorter.phase_end.sustained[shorter.phase_end.known == before].any())


def further(contact_set: ContactSet, near: float, before: np.ndarray, after: np.ndarray) -> tuple[Observation, ...]:
    """Return contacts that are not near.

    Args:
        contact_set: contacts after a flow.
        near: gap, m, above which they are looked for.
        before: velocity at the start of the flow, (nv,).
        after: at its end.
    """
    gap = contact_set.contacts.gap
    far = np.flatnonzero(gap > near)
    rate, first = (contact_set.contact_velocity(velocity)[far] for velocity in (after, before))
    return tuple(sighted(-1 - contact_set.pattern.key[far], gap[far], rate, first))


def sighted(contact: np.ndarray, *columns: np.ndarray) -> Iterator[Observation]:
    """Return contacts by their gaps, from the columns of `Observation`, (k,) each."""
    order = columns[0].argsort()
    return map(Observation, contact[order].tolist(), *(column[order].tolist() for column in columns))


def expected(start: ContactState, tolerance: float) -> float:
    """Return when a gap is expected to close, s, if contacts bend on as the last flow has bent them; infinite if none.

    That is the first zero of ``gap + velocity t + bend t^2`` of any contact whose bend is known, or which approaches. A
    contact that is closed is to rise by more than the tolerance first.
    """
    if start.bend is None:
        return math.inf
    earliest = math.inf
    columns = start.gap, start.contact_velocity, start.bend, start.rounding
    for gap, velocity, bend, rounding in zip(*(column.tolist() for column in columns), strict=True):
        closed = gap <= tolerance
        if closed and (velocity <= rounding or bend >= 0.0):
            continue
        time = parabola_closes(max(gap, 0.0), velocity, bend)
        if time < earliest and not (closed and velocity * time <= _RESTS * tolerance):
            earliest = time
    return earliest


def _bend(phase_end: PhaseEnd, phase: Phase) -> np.ndarray:
    """Return b of ``gap + velocity t + b t^2`` over a flow, m/s^2, (h,); 0 for those held, or not there."""
    (now, known, sustained), start, tau = phase_end, phase.start, phase.duration
    if not len(start.gap):
        return np.zeros(len(known))
    depth = now.gap - start.gap[known] - start.contact_velocity[known] * tau
    bent = (known >= 0) & ~sustained & (np.abs(depth) > CORRECTED * phase.tolerance)
    return np.where(bent, depth / tau**2, 0.0)


def _clear(gap: np.ndarray, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return gaps at the end of a flow, from the start's where contacts were deeper than the tolerance there."""
    start = phase.start.gap
    if not len(start) or start.min() >= -phase.tolerance:
        return gap
    before = np.where(known >= 0, start[known], 0.0)
    return gap - np.where(before < -phase.tolerance, before, 0.0)
