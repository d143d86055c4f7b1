"""Find gaps that close and open again within a smooth phase, so that its end does not show it.

Such a gap ``g(t)`` first falls and finally rises. It is taken to be convex, like that of balls that graze each other or
of a ball thrown at a ceiling, so that it lies above its tangents. Therefore only a contact that opens at the end T of a
phase with ``g(T) - T g'(T) < 0`` can have been closed meanwhile, and only if it closes at the start. For the remaining
contacts, trial steps look for the lowest point of the gap.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from impactlaw.scene.detection import Detector, Distances
from impactlaw.scene.patterns import Pattern
from impactlaw.scene.tolerances import SKIN
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import ContactState
from impactlaw.stepping.event_driven.location.gap_functions import Node
from impactlaw.stepping.event_driven.location.travel import Frames, Travel
from impactlaw.stepping.event_driven.location.trial_step import TrialStep
from impactlaw.stepping.event_driven.matching import match

_TRIALS = 12  # largest number of trial steps for the lowest point of one gap; smooth gaps take one or two
_TURNS = 0.1  # part of the longest turn up to which the nearest points of bodies stay in place
_INNER = 0.02  # distance of a trial step from the ends of its bracket, as a part of the bracket
_WIDE = 1e-2  # part of the scene's size above which the crude bound on motion is too wide for a look at contacts


class Dips:
    """Finds the gaps that have closed and opened again within a phase."""

    def __init__(
        self, configuration: Configuration, detector: Detector, travel: Travel, *, near: float, tolerance: float
    ):
        self._configuration, self._detector, self._travel = configuration, detector, travel
        self._near, self._tolerance = near, tolerance
        self._extent = float(configuration.model.stat.extent)

    def is_clear(self, start: Frames | None, before: np.ndarray, duration: float) -> bool:
        """Return whether no contact is near now, nor can have been closed within the phase that has just ended.

        ``start`` are the frames at its start, None if they are not known.
        """
        data, detector = self._configuration.data, self._detector
        if detector.is_at_limit(data, self._near):
            return False
        reach = self._reach(before, duration)
        apart = detector.distances(data, max(reach, self._near))
        if apart is None:
            return True
        if apart.are_cut:  # the nearest may be missing
            return False
        least = apart.distance.item(apart.distance.argmin())
        if least < self._near + SKIN or self._opened(apart, start, before, duration, reach):
            return False
        data.ncon = 0  # as if only near contacts had been looked for
        return True

    def are_together(
        self,
        pattern: Pattern,
        start: Frames | None,
        before: np.ndarray,
        duration: float,
        gaps: tuple[float, float],
    ) -> bool:
        """Return whether only contacts of a plain pattern are near now, all closed, and no other was closed meanwhile.

        ``gaps`` are the smallest and the largest gap that count as closed, m; see `Detector.are_closed`.
        """
        data, detector = self._configuration.data, self._detector
        reach = self._reach(before, duration)
        if detector.are_closed(data, max(reach, self._near), pattern, gaps):
            return True
        apart = Distances.of(data)
        if reach <= self._near or apart is None or self._opened(apart, start, before, duration, reach):
            return False
        return detector.are_closed(data, self._near, pattern, gaps)

    def _opened(
        self, apart: Distances, start: Frames | None, before: np.ndarray, duration: float, reach: float
    ) -> bool:
        """Return whether one of these pairs that is not near now may have been closed within a phase."""
        limit = self._near + SKIN
        if start is not None:
            chosen = ((apart.distance > limit) & self._may_dip(apart, start, before, duration)).nonzero()[0].tolist()
        else:
            travel = self._travel.by(before, self._configuration.data.qvel, duration).tolist()
            drift = 2.0 * self._travel.drift(duration)
            pairs = enumerate(zip(apart.geoms.tolist(), apart.distance.tolist(), strict=True))
            chosen = [k for k, ((i, j), gap) in pairs if limit < gap <= travel[i] + travel[j] + drift + SKIN]
        if not chosen:
            return False
        found = self._detect(reach)
        opens = _opens(found.gap, self._slopes(found.contact_velocity, before), duration, self._tolerance)
        return bool(np.count_nonzero(opens & (found.gap > self._near)))

    def find(self, trial: TrialStep, state: np.ndarray, try_for: Callable[[float], TrialStep]) -> TrialStep | None:
        """Return a shorter trial in which a gap is negative that has opened again in this one; None if there is none.

        Args:
            trial: the phase. The scene is at its end, and is there again if None is returned.
            state: the state saved at its start.
            try_for: tries a phase of another duration, s, from the same start.
        """
        phase, data, now = trial.phase, self._configuration.data, trial.phase_end.now
        before, duration = phase.start.velocity, phase.duration
        within = self._reach(before, duration)
        if within <= self._near:
            return None
        found, near, count = now.contact_set, now.pattern, now.pattern.geom_contacts
        apart = self._detector.distances(data, within)
        if apart is not None and (near.several or len(apart.distance) > count):
            new = self._new(apart, phase.start)
            may_dip = self._may_dip(apart, phase.start.frames, before, duration).tolist() if new else []
            if any(may_dip[i] for i in new):
                found = self._detect(within)
                phase.work.look(len(found.gap))
        sustained = trial.phase_end.sustained
        if found is now.contact_set and np.count_nonzero(sustained) == len(sustained):
            found = None
        if count == 0:
            data.ncon = 0
        elif data.ncon != count:
            self._detector.refresh(data, self._near, near)
        suspects = {} if found is None else self._suspects(found, trial)
        if not suspects:
            return None
        return self._search(suspects, trial, state, try_for, within)

    def _may_dip(self, apart: Distances, start: Frames, before: np.ndarray, duration: float) -> np.ndarray:
        """Return which pairs can have met meanwhile, given their motion since the start of the phase, bool (h,)."""
        opened = self._travel.along(start, self._configuration.data, apart) + self._bend(before, duration)
        return apart.distance <= opened + SKIN

    def _new(self, apart: Distances, start: ContactState) -> list[int]:
        """Return the pairs that are not near now, and did not start the phase with their only contact closed."""
        known, limit = set(start.pattern.key[start.closed & start.pattern.single].tolist()), self._near + SKIN
        count, pairs = self._configuration.model.ngeom, zip(apart.geoms.tolist(), apart.distance.tolist(), strict=True)
        far = ((i, pair) for i, (pair, gap) in enumerate(pairs) if gap > limit)
        return [i for i, pair in far if min(pair) * count + max(pair) not in known]

    def _search(
        self,
        suspects: dict[int, Node],
        trial: TrialStep,
        state: np.ndarray,
        try_for: Callable[[float], TrialStep],
        within: float,
    ) -> TrialStep | None:
        """Look for a trial in which one of these contacts, given by their keys, is closed; see `find`."""
        phase, end, tried = trial.phase, self._configuration.save(), False
        starts = self._at_start(suspects, trial, state, within)
        for key, start in starts.items():

            def gap_after(time: float, key: int = key) -> tuple[TrialStep, Node | None]:
                shorter = try_for(time)
                if shorter.gap < -self._tolerance:
                    return shorter, None
                nodes = self._nodes(self._detect(within), phase.start.velocity, time)
                return shorter, nodes.get(key)

            tried = tried or _lowest(start, suspects[key], -self._tolerance) < -self._tolerance
            shorter = _find_negative(gap_after, start, suspects[key], self._tolerance)
            if shorter is not None:
                return shorter
        if tried:
            try_for(phase.duration)
        else:
            self._configuration.restore(end)
            self._configuration.update()
            self._detector.refresh(self._configuration.data, self._near, trial.phase_end.now.pattern)
        return None

    def _at_start(
        self, suspects: dict[int, Node], trial: TrialStep, state: np.ndarray, within: float
    ) -> dict[int, Node | None]:
        """Return the suspects that close at the start of the phase, with their gaps there.

        The gap is None if bodies turn too far for the start to tell.
        """
        phase = trial.phase
        self._configuration.restore(state)
        velocity = phase.start.velocity
        found = self._detect(within)
        phase.work.look(len(found.gap))
        at_start = self._nodes(found, velocity, 0.0)
        turns = phase.duration > _TURNS * self._travel.longest_turn(velocity)
        single = dict(zip(found.pattern.key.tolist(), found.pattern.single.tolist(), strict=True))
        return {
            key: None if turns and not single[key] else at_start[key]
            for key in suspects
            if key in at_start and (at_start[key].slope < 0.0 or (turns and not single[key]))
        }

    def _suspects(self, found: ContactSet, trial: TrialStep) -> dict[int, Node]:
        """Return contacts that may have been closed within a trial, by key, except those that were closed before."""
        phase, phase_end = trial.phase, trial.phase_end
        slope = self._slopes(found.contact_velocity, phase.start.velocity)
        opens = _opens(found.gap, slope, phase.duration, self._tolerance)
        if not np.count_nonzero(opens):
            return {}
        known = phase_end.known if found is phase_end.now.contact_set else match(found, phase)
        if len(phase.start.closed):
            opens &= ~((known >= 0) & phase.start.closed[known])
        held = phase_end.now.pattern.key[phase_end.sustained]
        opens &= ~(found.pattern.vague & np.isin(found.pattern.key, held))
        if not np.count_nonzero(opens):
            return {}
        result: dict[int, Node] = {}
        for i in np.flatnonzero(opens)[np.argsort(-found.gap[opens])].tolist():
            result[int(found.pattern.key[i])] = Node(phase.duration, float(found.gap[i]), float(slope[i]))
        return result

    def _nodes(self, found: ContactSet, before: np.ndarray, time: float) -> dict[int, Node]:
        """Return the smallest gap of each pair after a time, s; at the start, the gap that closes fastest."""
        slope = self._slopes(found.contact_velocity, before) if time > 0.0 else found.contact_velocity(before)
        order = np.argsort(-slope if time == 0.0 else -found.gap)
        key = found.pattern.key
        return {int(key[i]): Node(time, float(found.gap[i]), float(slope[i])) for i in order.tolist()}

    def _slopes(self, rates: Callable[[np.ndarray], np.ndarray], before: np.ndarray) -> np.ndarray:
        """Return the derivative of gaps by the duration of the phase, m/s, (h,), given contact velocities by qvel.

        The semi-implicit integrators move with the velocity of the end, so that ``q(T) = q(0) + T v(T)``.
        """
        rate = rates(self._configuration.data.qvel)
        return rate if self._configuration.is_rk4 else 2.0 * rate - rates(before)

    def _detect(self, within: float) -> ContactSet:
        """Return all current contacts with a gap up to ``within``, m."""
        self._configuration.refresh()
        return ContactSet(self._detector.look(self._configuration.data, within), self._configuration)

    def _bend(self, before: np.ndarray, duration: float) -> float:
        """Return a bound on how far two geoms came closer in a phase than their motion from start to end shows, m."""
        change = mujoco.mju_norm(self._configuration.data.qvel - before)
        return 0.5 * self._travel.farthest * change * duration + self._travel.drift(duration)

    def _reach(self, before: np.ndarray, duration: float) -> float:
        """Return a bound on how much closer two geoms can have come in a phase, m, at most the size of the scene."""
        after = self._configuration.data.qvel
        reach = self._travel.closing(before, after, duration)
        if reach > _WIDE * self._extent:
            reach = min(reach, 2.0 * max(self._travel.by(before, after, duration).tolist(), default=0.0))
        return min(reach + 2.0 * self._travel.drift(duration), self._extent)


def _opens(gap: np.ndarray, slope: np.ndarray, duration: float, tolerance: float) -> np.ndarray:
    """Return which gaps grow now and, by their tangents, may have been closed within a phase, bool (h,)."""
    return (slope > 0.0) & (gap - slope * duration < -tolerance)


def _find_negative(
    gap_after: Callable[[float], tuple[TrialStep, Node | None]], low: Node | None, high: Node, tolerance: float
) -> TrialStep | None:
    """Return a trial at whose end a gap is negative; None if the gap is never negative, or no such trial is found.

    Args:
        gap_after: tries a phase of a given time, s; returns the trial and the gap, None if it is negative or far.
        low: a node where the gap falls; None if it is not known, and then the bracket begins at 0.
        high: a node where the gap rises.
        tolerance: depth up to which a gap does not count as negative, m.
    """
    for _ in range(_TRIALS):
        if _lowest(low, high, -tolerance) >= -tolerance:
            return None
        begin = 0.0 if low is None else low.time
        time = 0.5 * (begin + high.time) if low is None else _bottom(low, high)
        trial, node = gap_after(time)
        if trial.gap < -tolerance:
            return trial
        if node is None:
            return None
        if node.slope > 0.0:
            high = node
        else:
            low = node
    return None


def _lowest(low: Node | None, high: Node, least: float) -> float:
    """Return a lower bound of a convex gap between two times, m, by its tangents, or any bound below ``least``."""
    if low is None:
        return -math.inf if high.gap - high.slope * high.time < least else 0.0
    meet = (low.gap - high.gap + high.slope * high.time - low.slope * low.time) / (high.slope - low.slope)
    return low.gap + low.slope * (meet - low.time)


def _bottom(low: Node, high: Node) -> float:
    """Return the time of the lowest point of the cubic through two nodes, between which it falls and then rises."""
    span = high.time - low.time
    rise, first, last = high.gap - low.gap, low.slope * span, high.slope * span
    two, three = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    part = -first / (two + math.sqrt(max(two * two - 3.0 * three * first, 0.0)) or math.inf)
    return low.time + span * min(max(part, _INNER), 1.0 - _INNER)
