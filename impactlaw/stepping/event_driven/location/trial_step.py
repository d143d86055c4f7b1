"""A trial of a smooth phase, and what it shows about the gaps."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from impactlaw.stepping.event_driven.contact_state import Phase, PhaseEnd
from impactlaw.stepping.event_driven.location.gap_functions import Observation


class TrialStep(NamedTuple):
    """A smooth phase that has been tried: the contacts at its end, and the smallest gap of those that are not held."""

    phase: Phase  # the phase
    phase_end: PhaseEnd  # the contacts at its end
    # smallest gap of contacts that are not held, m; a contact that overlapped at the start counts from its depth there
    gap: float
    deepest: int  # index of that contact, -1 if no contact is near
    # what remains to be done if the phase is kept, see `kept`; None if that is nothing
    keep: Callable[[], PhaseEnd] | None = None

    @classmethod
    def of(cls, phase: Phase, phase_end: PhaseEnd, keep: Callable[[], PhaseEnd] | None, far: float) -> TrialStep:
        """Return the trial step for the contacts at the end of a phase; its gap is ``far``, m, if all are held."""
        opened = (~phase_end.sustained).nonzero()[0]
        if not len(opened):
            return cls(phase, phase_end, far, -1, keep)
        clear = _clear(phase_end.now.gap[opened], phase_end.known[opened], phase)
        least = int(clear.argmin())
        return cls(phase, phase_end, clear.item(least), opened.item(least), keep)

    def kept(self) -> TrialStep:
        """Return the same trial with the velocities of held contacts; the scene must be at its end."""
        return self if self.keep is None else self._replace(phase_end=self.keep(), keep=None)

    @property
    def duration(self) -> float:
        """Duration of the phase, s."""
        return self.phase.duration

    @property
    def was_closed(self) -> bool:
        """Whether the deepest contact penetrates and was closed, and no deeper, at the start of the phase."""
        if self.gap >= -self.phase.tolerance:
            return False
        before = self.phase_end.known[self.deepest]
        return bool(before >= 0 and abs(self.phase.start.gap[before]) <= self.phase.tolerance)

    def least_gap(self, pair: int) -> float:
        """Return the smallest gap of a pair of geoms, given by its key, m; infinite if none is near."""
        now = self.phase_end.now
        return float(now.gap[now.pattern.key == pair].min(initial=np.inf))

    @property
    def observations(self) -> list[Observation]:
        """Contacts that are not held, by gap; those that were not near at the start are identified by their geoms."""
        now, known, sustained = self.phase_end
        before = now.contact_set.contact_velocity(self.phase.start.velocity)
        columns = sustained, known, now.pattern.key, _clear(now.gap, known, self.phase), now.contact_velocity, before
        rows = zip(*map(np.ndarray.tolist, columns), strict=True)
        found = [Observation(i if i >= 0 else -1 - key, *motion) for held, i, key, *motion in rows if not held]
        found.sort(key=itemgetter(1))
        return found


def _clear(gap: np.ndarray, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return the gaps at the end of a phase, relative to the start for contacts that overlapped there."""
    start = phase.start.gap
    if not len(start) or start.item(start.argmin()) >= -phase.tolerance:
        return gap
    before = np.where(known >= 0, start[known], 0.0)
    return gap - np.where(before < -phase.tolerance, before, 0.0)
