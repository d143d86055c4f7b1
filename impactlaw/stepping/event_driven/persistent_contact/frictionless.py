"""Contacts that stay closed during a flow: which ones do, and the impulse that keeps them closed.

A contact is sustained over a flow of duration tau if it was closed at the start and either did not separate, or
separated so slowly that its rebound rises less than the gap tolerance, ``gamma^2 / (2 a) <= tolerance`` with a the
closing acceleration that the flow shows. This is also what ends a Zeno sequence of ever smaller bounces. The
acceleration of a contact is looked at again once those below it are held: in a stack that falls freely it is zero.

The flow itself knows no contact but the forces of the flow before (`felt_force`), which are taken away from where it
ends; then position and velocity are brought back to the closed contacts:

    position:  min |d|,  gap(q + d) >= 0           (kinetic metric; Gauss-Newton on the gaps)
    velocity:  0 <= nu  ⊥  J (w + M^-1 J^T nu) >= 0,   w = v + M^-1 (J_start - J)^T nu' / 2,   v <- w + M^-1 J^T nu

where nu' solves the second line with w = v. The term with ``J_start - J`` gives half of the impulse the direction it
had at the start of the flow (as in RATTLE), so that RK4 keeps second order along curved surfaces; on flat ones it
vanishes.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from impactlaw.errors import UnsolvableLawError
from impactlaw.scene.contacts import update_positions
from impactlaw.solvers import Problem, solve_with_jump, with_active
from impactlaw.stepping.event_driven.contact_set import ContactSet, jump, whiten
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState, Phase, PhaseEnd, stays
from impactlaw.stepping.event_driven.persistent_contact.felt_force import FeltForce, constrained_velocity
from impactlaw.stepping.event_driven.persistent_contact.frictional import hold_with_friction
from impactlaw.stepping.work import Work

_CORRECTIONS = 20  # position corrections at most
_SMOOTH_CORRECTIONS = 3  # that smooth surfaces need; each gains digits, their curvature decides how many
_LARGEST_TURN = 0.3  # rad in one flow
_CONFLICT = 1e-9  # part of the largest of multipliers that prove a conflict above which one takes part in it


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    look_again: Callable[[float], tuple[ContactState, np.ndarray]],
) -> tuple[PhaseEnd, Callable[[], PhaseEnd] | None]:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        phase_end: the contacts there.
        phase: what led there.
        look_again: detects the contacts of now up to a gap at least, m, and matches them with the start.

    Returns:
        The contacts after the correction, and what is left to do if the flow is to be kept: see `hold_with_friction`.
    """
    phase.work.hold(len(phase_end.now.gap))
    if phase_end.now.contact_set.pattern.friction_pattern is not None:

        def correct(overlapping: PhaseEnd) -> PhaseEnd:
            return _hold_position(model, data, overlapping, phase, None, look_again, np.zeros(model.nv))[0]

        return hold_with_friction(model, data, phase_end, phase, look_again, correct)
    before, guess = phase.start.active, None
    if before is not None:
        guess = (phase_end.known >= 0) & before[phase_end.known]
    phase_end.now.contact_set.whitened(model, data)
    felt = FeltForce.of(model, data, phase.start.force, phase.duration)
    free = constrained_velocity(model, data, phase_end.now, phase) - felt.velocity
    amiss = phase_end.now.gap < -CORRECTED * phase.tolerance
    if guess is not None and phase.start.force is not None:
        amiss |= guess & (phase_end.now.gap > CORRECTED * phase.tolerance)
    if np.count_nonzero(phase_end.sustained & amiss):
        phase_end, guess = _hold_position(model, data, phase_end, phase, guess, look_again, felt.shift)
    now, known, sustained = phase_end
    held = sustained & now.closed
    if phase.start.force is not None or np.count_nonzero(held & (now.contact_velocity < -now.noise)):
        active, force = _hold_velocity(model, data, phase_end, phase, guess, free, felt)
        return PhaseEnd(now.moving(model, data, active, force=force), known, sustained), None
    return phase_end, None


def _hold_position(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    guess: np.ndarray | None,
    look_again: Callable[[float], tuple[ContactState, np.ndarray]],
    felt: np.ndarray,
) -> tuple[PhaseEnd, np.ndarray | None]:
    """Return the contacts where those that are sustained do not overlap, and which of them press.

    A shift that they have felt in the flow, (nv,), is theirs: they may pull back so far.
    """
    end, end_gap = data.qpos.copy(), phase_end.now.gap[phase_end.sustained]
    shift, active = np.zeros(model.nv), guess
    cuts, reach = (np.zeros((0, model.nv)), np.zeros(0)), phase_end.now.contact_set.opening(felt)
    for correction in range(_CORRECTIONS):
        now, known, sustained = phase_end
        sustained, active, wanted = _position_impulse(model, data, phase_end, shift + felt, phase, cuts, active)
        wanted = wanted - felt
        if correction == 0 and not (np.count_nonzero(active) or np.count_nonzero(felt)):
            return PhaseEnd(now, known, sustained), None
        if correction and now.contact_set.opening(wanted - shift) <= CORRECTED * phase.tolerance:
            break  # what still overlaps is squeezed between bodies that cannot give way
        if correction >= _SMOOTH_CORRECTIONS:  # the contacts jump between points of a face: keep them all
            J = now.contact_set.jacobian[sustained]
            cuts = np.vstack([cuts[0], J]), np.concatenate([cuts[1], J.dot(shift + felt) - now.gap[sustained]])
        shift = wanted
        qpos = end.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        before, (now, known) = known, look_again(reach)
        if known is not before and not np.array_equal(known, before):
            if not np.isin(before[active & (before >= 0)], known).all():  # pushed out further than contacts are sought
                now, known = look_again(float(-end_gap.min()))
            active = _among(known, before[active])
            sustained = _among(known, before[sustained])  # what the flow has decided stays decided
        phase_end = PhaseEnd(now, known, sustained)
        if _is_corrected(phase_end, active, phase):
            break
    return phase_end, active


def _is_corrected(phase_end: PhaseEnd, active: np.ndarray, phase: Phase) -> bool:
    """Return whether sustained contacts do not overlap, those that press are closed, and no other should be held."""
    gap, sustained, allowed = phase_end.now.gap, phase_end.sustained, CORRECTED * phase.tolerance
    if np.count_nonzero((sustained & (gap < -allowed)) | (active & (np.abs(gap) > allowed))):
        return False
    if np.count_nonzero(sustained) == len(sustained):
        return True
    return not np.count_nonzero(stays(gap, phase_end.known, phase) & ~sustained)


def _among(known: np.ndarray, some: np.ndarray) -> np.ndarray:
    return (known[:, None] == some[some >= 0]).any(axis=1)


def _position_impulse(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    shift: np.ndarray,
    phase: Phase,
    cuts: tuple[np.ndarray, np.ndarray],
    guess: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which contacts are sustained, which of them press, and the shift, (nv,), that opens them.

    The cuts are gradients and least shifts along them of contacts that were seen there before.
    """
    contact_set, sustained = phase_end.now.contact_set, phase_end.sustained
    gap, J = contact_set.contacts.gap, contact_set.jacobian
    along, Y, _ = contact_set.whitened(model, data)
    while True:
        rows = np.flatnonzero(sustained)
        gradients, least, part = along[rows], J[rows].dot(shift) - gap[rows], Y[rows]
        if len(cuts[1]):
            phase.work.cut(len(least) + len(cuts[1]))
            guess = None
            more_gradients, more = contact_set.confine(model, data, cuts[0])
            gradients, least = np.vstack([gradients, more_gradients]), np.concatenate([least, cuts[1]])
            part = np.vstack([part, more])
        p = _opening(part, least, None if guess is None else guess[rows], phase.work)
        wanted = jump(model, data, gradients, p)
        if len(rows) == len(gap):
            return sustained, p[: len(rows)] > 0, wanted
        more = stays(gap + J.dot(wanted - shift), phase_end.known, phase) & ~sustained
        if not np.count_nonzero(more):
            active = np.zeros(len(gap), dtype=bool)
            active[rows[p[: len(rows)] > 0]] = True
            return sustained, active, wanted
        sustained = sustained | more


def _opening(gradients: np.ndarray, least: np.ndarray, guess: np.ndarray | None, work: Work) -> np.ndarray:
    """Return what `_pushing` returns, and 0 for contacts of bodies that cannot give way, or not all at once."""
    able = np.vecdot(gradients, gradients) > 0
    if np.count_nonzero(able) == len(able):
        try:
            return _pushing(gradients, least, guess)
        except UnsolvableLawError as conflict:
            work.disagree(len(least))
            able = conflict.ray <= _CONFLICT * conflict.ray.max()
    p = np.zeros(len(least))
    if np.count_nonzero(able):
        p[able] = _opening(gradients[able], least[able], None if guess is None else guess[able], work)
    return p


def _hold_velocity(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    guess: np.ndarray | None,
    velocity: np.ndarray,
    felt: FeltForce,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Set data.qvel so that no closed contact that is sustained approaches; return which press, and their force.

    Args:
        model: the scene.
        data: where sustained contacts do not overlap, frames current.
        phase_end: the contacts there.
        phase: what led there.
        guess: which contacts may press, bool (h,).
        velocity: without contact, (nv,).
        felt: what the flow has felt.
    """
    contact_set, start = phase_end.now.contact_set, phase.start.contact_set
    held = np.flatnonzero(phase_end.sustained & phase_end.now.closed)
    along, _, lengths = contact_set.whitened(model, data)
    lengths = lengths[held]
    if not len(held):
        data.qvel[:] = velocity
        return np.zeros(len(phase_end.known), dtype=bool), None
    guess = None if guess is None else guess[held]
    nu = _pressing(model, data, contact_set, held, velocity, guess)
    known = phase_end.known[held]
    J = contact_set.jacobian[held]
    difference = np.where(known[:, None] >= 0, start.jacobian[known] - J, 0.0) if start.pattern else J - J
    if np.count_nonzero(difference):
        difference, turned = contact_set.confine(model, data, difference)
        change = np.sqrt(np.vecdot(turned, turned))
        difference[change > _LARGEST_TURN * lengths] = 0.0  # another feature of the surface, not a curved one
        if np.count_nonzero(change > 1e-12 * lengths):
            velocity += jump(model, data, difference, 0.5 * nu)
            nu = _pressing(model, data, contact_set, held, velocity, nu > 0)
    impulse, change = nu.dot(along[held]), jump(model, data, along[held], nu)
    data.qvel[:] = velocity + change
    active = np.zeros(len(phase_end.known), dtype=bool)
    active[held] = nu > 0
    return active, impulse / phase.duration if felt.is_settled(impulse, change) else None


def _pressing(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contact_set: ContactSet,
    held: np.ndarray,
    velocity: np.ndarray,
    guess: np.ndarray | None,
) -> np.ndarray:
    """Return ``nu`` with ``0 <= nu  ⊥  J (v + M^-1 J'^T nu) + w >= 0`` for the contacts that are held, (h,)."""
    Y = contact_set.whitened(model, data)[1][held]
    gamma = contact_set.contact_velocity(velocity)[held]
    known = contact_set.bilateral is None and contact_set.drift is None and len(held) > 1
    return _pushing(Y, -gamma, guess, -whiten(model, data, velocity) if known else None)


def _pushing(
    gradients: np.ndarray, bound: np.ndarray, guess: np.ndarray | None, preimage: np.ndarray | None = None
) -> np.ndarray:
    """Return ``p`` with ``0 <= p  ⊥  Y Y^T p >= c``, (h,); see `Problem`.

    One contact has a closed form; else the contacts that are expected to carry an impulse are tried first.
    """
    if len(bound) == 1 and (square := gradients[0].dot(gradients[0])) > 0:
        return np.maximum(bound / square, 0.0)
    problem = Problem(gradients, bound, preimage)
    if guess is not None:
        impulse = with_active(problem, guess)
        if impulse is not None:
            return impulse
    return solve_with_jump(problem, ("",) * len(bound), shared=False).impulse
