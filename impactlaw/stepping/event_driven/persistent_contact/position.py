"""Correct positions by the smallest shift that opens the gaps of contacts that stay closed.

With the gaps at the end of a phase, in the kinetic metric, by Gauss-Newton:

    min |d|,   gap(q + d) >= 0
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

import numpy as np

from impactlaw.errors import UnfinishedStepError, UnsolvableLawError
from impactlaw.solvers import Problem, solve_with_jump
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState, Phase, PhaseEnd, stays
from impactlaw.stepping.event_driven.matching import among
from impactlaw.stepping.work import Work

DetectAgain = Callable[[float], tuple[ContactState, np.ndarray]]
"""Detects current contacts up to a gap, m, and matches them with those at the start of the phase."""

_CORRECTIONS = 20  # largest number of corrections
_SMOOTH_CORRECTIONS = 3  # corrections that smooth surfaces need; each gains digits, depending on the curvature
_FAR = 1e3  # largest distance by which bodies may be moved to open an overlap, in depths of the overlap
_CONFLICT = 1e-9  # smallest multiplier of a contact in a conflict, relative to the largest in its proof


class Cuts(NamedTuple):
    """Contacts seen in earlier corrections, kept if contact points jump on a face."""

    jacobian: np.ndarray  # gap gradients of these contacts, (n, nv)
    least: np.ndarray  # smallest shift along them, m, (n,)


class Correction(NamedTuple):
    """One step of Gauss-Newton."""

    sustained: np.ndarray  # contacts that stay closed, bool (h,)
    active: np.ndarray  # contacts that need an impulse to stay closed, bool (h,)
    shift: np.ndarray  # the shift that opens the contacts, (nv,)


def hold_position(phase_end: PhaseEnd, phase: Phase, detect_again: DetectAgain, felt: np.ndarray) -> PhaseEnd:
    """Move the scene so that sustained contacts do not overlap; return the contacts there.

    The correction may undo the shift ``felt``, (nv,), that contact forces have made in the phase.

    Raises:
        UnfinishedStepError: the correction would move bodies by far more than they overlap, because equality
            constraints leave contacts almost no motion.
    """
    configuration = phase_end.now.configuration
    end, end_gap = configuration.data.qpos.copy(), phase_end.now.gap[phase_end.sustained]
    shift, reach = np.zeros(configuration.model.nv), phase_end.now.contact_set.opening(felt)
    limit, place = _FAR * max(reach, -float(end_gap.min()), phase.tolerance), configuration.data.geom_xpos
    cuts: Cuts | None = None
    for correction in range(_CORRECTIONS):
        now, known, _ = phase_end
        sustained, active, wanted = _correction(phase_end, shift + felt, phase, cuts)
        wanted = wanted - felt
        if correction == 0:
            if not (np.count_nonzero(active) or np.count_nonzero(felt)):
                return PhaseEnd(now, known, sustained)
            place = place.copy()
        if correction and now.contact_set.opening(wanted - shift) <= CORRECTED * phase.tolerance:
            break  # the remaining overlap is squeezed between bodies that cannot give way
        if correction >= _SMOOTH_CORRECTIONS:  # contacts jump between points of a face: keep them all
            J = now.contact_set.jacobian[sustained]
            least = J.dot(shift + felt) - now.gap[sustained]
            cuts = Cuts(J, least) if cuts is None else Cuts(*map(np.concatenate, zip(cuts, (J, least), strict=True)))
        shift = wanted
        configuration.shift(shift, qpos=end)
        before, (now, known) = known, detect_again(reach)
        if np.count_nonzero(np.abs(configuration.data.geom_xpos - place) > limit):
            raise UnfinishedStepError("equality constraints leave contacts next to no motion: they were not held")
        if known is not before and not np.array_equal(known, before):
            if not among(before[active & (before >= 0)], known).all():  # pushed out of the range of the look
                now, known = detect_again(float(-end_gap.min()))
            active = among(known, before[active])
            sustained = among(known, before[sustained])  # the phase's decision stands
            new = ~among(known, before)
            if np.count_nonzero(new) and not phase.hold_all:
                sustained |= new & stays(_led(now, known, phase), known, phase)
        phase_end = PhaseEnd(now, known, sustained)
        if _is_corrected(phase_end, active, phase):
            break
    return phase_end


def _led(now: ContactState, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return the gaps that follow from the gaps at the start and the velocities at both ends of the phase, m, (h,)."""
    start = phase.start
    return start.gap[known] + 0.5 * phase.duration * (start.contact_velocity[known] + now.contact_velocity)


def _is_corrected(phase_end: PhaseEnd, active: np.ndarray, phase: Phase) -> bool:
    """Return whether no sustained contact overlaps, active contacts are closed, and no other contact should be held."""
    gap, sustained, allowed = phase_end.now.gap, phase_end.sustained, CORRECTED * phase.tolerance
    for one, held, pushed in zip(gap.tolist(), sustained.tolist(), active.tolist(), strict=True):
        if (held and one < -allowed) or (pushed and abs(one) > allowed):
            return False
    if np.count_nonzero(sustained) == len(sustained):
        return True
    return not np.count_nonzero(stays(gap, phase_end.known, phase) & ~sustained)


def _correction(phase_end: PhaseEnd, shift: np.ndarray, phase: Phase, cuts: Cuts | None) -> Correction:
    """Return the shift that opens the contacts, linearized at the scene shifted by ``shift``, (nv,)."""
    contact_set, gap, sustained = phase_end.now.contact_set, phase_end.now.gap, phase_end.sustained
    J = contact_set.jacobian
    while True:
        rows = sustained.nonzero()[0]
        gradients, least, part = J[rows], J[rows].dot(shift) - gap[rows], contact_set.yielding[rows]
        if cuts is not None:
            phase.work.cut(len(least) + len(cuts.least))
            gradients, least = np.vstack([gradients, cuts.jacobian]), np.concatenate([least, cuts.least])
            part = np.vstack([part, contact_set.whiten(cuts.jacobian)])
        p = _opening_impulse(part, least, phase.work)
        wanted = contact_set.configuration.jump(gradients, p)
        more = None
        if len(rows) < len(gap):
            more = ~sustained & stays(gap + J.dot(wanted - shift), phase_end.known, phase)
        if more is None or not np.count_nonzero(more):
            active = np.zeros(len(gap), dtype=bool)
            active[rows[p[: len(rows)] > 0]] = True
            return Correction(sustained, active, wanted)
        sustained = sustained | more


def _opening_impulse(gradients: np.ndarray, least: np.ndarray, work: Work) -> np.ndarray:
    """Return `least_impulse`, with 0 for contacts of bodies that cannot give way, or cannot all give way at once."""
    able = np.vecdot(gradients, gradients) > 0
    if np.count_nonzero(able) == len(able):
        try:
            return least_impulse(gradients, least)
        except UnsolvableLawError as conflict:
            work.disagree(len(least))
            able = conflict.ray <= _CONFLICT * conflict.ray.max()
    p = np.zeros(len(least))
    if np.count_nonzero(able):
        p[able] = _opening_impulse(gradients[able], least[able], work)
    return p


def least_impulse(gradients: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """Return ``p`` with ``0 <= p  ⊥  Y Y^T p >= c``, (h,); see `Problem`."""
    if len(bound) == 1 and (square := gradients.dot(gradients.T).item()) > 0.0:
        inverse = 1.0 / sqrt(square)
        return np.maximum(bound * inverse * inverse, 0.0)
    return solve_with_jump(Problem(gradients, bound), ("",) * len(bound), shared=False).impulse
