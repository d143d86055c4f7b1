"""Persistent contact with friction: impulses in the friction cones that keep contacts closed and resist sliding.

After a smooth phase of duration tau to the velocity ``v``, with the effect of the applied contact forces subtracted
(`predicted_force`), the contacts that stay closed take impulses with

    u_n = J_n (v + M^-1 J^T Lambda) + w_n,   u_t = J_t (v + M^-1 J^T Lambda) + w_t
    0 <= Lambda_n  ⊥  u_n >= 0,   Coulomb's law between Lambda_t and u_t

(Moreau's time stepping with E = 0). Forces that are constant over the phase would also move the bodies: by
``tau M^-1 J^T Lambda`` with the semi-implicit integrators, by half of that with RK4. Therefore a contact that sticks
does not creep: friction undoes the motion by gravity. The remaining gaps are corrected as without friction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from impactlaw.errors import SolverError
from impactlaw.scene.friction_rows import contact_axes
from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.event_driven.contact_set import Rows
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactForces, Phase, PhaseEnd, stays
from impactlaw.stepping.event_driven.persistent_contact.position import DetectAgain, among, hold_position
from impactlaw.stepping.event_driven.persistent_contact.predicted_force import (
    PredictedForce,
    constrained_velocity,
    lasting,
    moving_part,
    turned_rows,
)
from impactlaw.stepping.work import Work

_SETTLINGS = 4  # largest number of shifts of position
_SOLUTIONS = 3  # largest number of solutions, if contacts that pushed are not found again in the corrected position
_STICKING = 2  # number of shifts in which sticking contacts do not slide, as long as the shifts close the contacts
_STICKS = 0.999  # part of the friction cone within which a contact sticks
_RANK = 1e-9  # relative singular value below which contacts are redundant
_KINDS = 6  # number of rows that a contact can have: the normal row, two of sliding, one of torsion, two of rolling
_OTHER = np.array([0, 2, 1, 3, 5, 4])  # kind of the row in the other direction of sliding or rolling
_SIGN = np.array([0, 1, -1, 0, 1, -1])  # sign of a right-handed spin from one row to the other


class _Impulses(NamedTuple):
    """Impulses of the sustained contacts."""

    rows: Rows  # rows of the contacts that take part
    each: np.ndarray  # impulse of each row, (n,)
    table: np.ndarray  # the same by contact and kind of row, (h, 6)


def hold_with_friction(
    phase_end: PhaseEnd, phase: Phase, detect_again: DetectAgain
) -> tuple[PhaseEnd, Callable[[], PhaseEnd]]:
    """Bring the position back to the sustained contacts; this moves the scene.

    If contacts that pushed are not found again in the corrected position, as on faces with many corners, impulses are
    solved for again without them: velocities will lack them, too, and the position must follow the velocity.

    Returns:
        The contacts after the correction, and a function that also brings back the velocity and returns the contacts
        with it. Until then they have the velocity from the impulses at the end of the phase, which is enough for a
        trial.
    """
    configuration = phase_end.now.configuration
    felt = PredictedForce.of(configuration, phase.start.force, phase.duration)
    free = constrained_velocity(phase_end.now, phase) - felt.velocity
    table, change, moved = np.zeros((0, _KINDS)), np.zeros_like(free), -felt.shift
    for _ in range(_SOLUTIONS):
        impulses = _solve(phase_end, phase, free, table)
        table, change = impulses.table, configuration.jump(impulses.rows.jacobian, impulses.each)
        pushing, shift = np.count_nonzero(table[:, 0] > 0), (moving_part(configuration) * phase.duration) * change
        reach = phase_end.now.contact_set.opening(shift)
        far = phase.duration * (configuration.kinetic_norm(free) + configuration.kinetic_norm(change))
        if np.count_nonzero(shift + moved):
            phase_end, table = _settle(phase_end, shift + moved, table, phase, detect_again, reach, far)
        phase_end, table = _opened(phase_end, table, phase, detect_again)
        if np.count_nonzero(table[:, 0] > 0) >= pushing:
            break
        moved = -shift
    now, velocity = phase_end.now, free + change
    configuration.data.qvel[:] = velocity
    tried = phase_end._replace(now=now._replace(contact_velocity=now.contact_set.contact_velocity(velocity)))
    return tried, partial(_hold_velocity, phase_end, phase, felt, free, table, configuration.added)


def _opened(
    phase_end: PhaseEnd, table: np.ndarray, phase: Phase, detect_again: DetectAgain
) -> tuple[PhaseEnd, np.ndarray]:
    """Open overlaps; return the contacts and their impulses."""
    phase_end = _with_more(phase_end, phase)
    if np.count_nonzero(phase_end.sustained & (phase_end.now.gap < -CORRECTED * phase.tolerance)):
        before, still = phase_end, np.zeros(phase_end.now.configuration.model.nv)
        phase_end = _with_more(hold_position(phase_end, phase, detect_again, still), phase)
        table = _matched(table, before, phase_end)
    return phase_end, table


def _hold_velocity(
    phase_end: PhaseEnd,
    phase: Phase,
    felt: PredictedForce,
    free: np.ndarray,
    guess: np.ndarray,
    added: np.ndarray | None,
) -> PhaseEnd:
    """Give the sustained contacts the velocity after their impulses; return them with these impulses.

    Half of an impulse acts along the rows at the start (`_turned`). That is left out if it makes a contact stop pushing
    that pushes without it; otherwise light limbs would be thrown off the ground.
    """
    now, configuration = phase_end.now, phase_end.now.configuration
    configuration.damp_again(added)  # other phases may have been tried meanwhile
    impulses = _solve(phase_end, phase, free, guess)
    turned = _turned(phase_end, phase, impulses.rows)
    if turned is not None:
        other = free + configuration.jump(turned, 0.5 * impulses.each)
        again = _solve(phase_end, phase, other, impulses.table)
        if not np.count_nonzero((impulses.table[:, 0] > 0) & (again.table[:, 0] <= 0)):
            free, impulses = other, again
    total = impulses.each.dot(impulses.rows.jacobian)
    change = configuration.velocity(total)
    configuration.data.qvel[:] = free + change
    force = lasting(now.contact_set, total / phase.duration) if felt.is_settled(total, change) else None
    contact_forces = ContactForces(impulses.rows, impulses.table / phase.duration)
    return phase_end._replace(now=now.moving(impulses.table[:, 0] > 0, contact_forces, force))


def _with_more(phase_end: PhaseEnd, phase: Phase) -> PhaseEnd:
    """Return the contacts; those that stay closed because others are now held are sustained, too."""
    now, known, sustained = phase_end
    return PhaseEnd(now, known, sustained | stays(now.gap, known, phase))


def _settle(
    phase_end: PhaseEnd,
    shift: np.ndarray,
    table: np.ndarray,
    phase: Phase,
    detect_again: DetectAgain,
    reach: float,
    far: float,
) -> tuple[PhaseEnd, np.ndarray]:
    """Shift the bodies, and then close the active contacts; return the contacts and their impulses.

    Sticking contacts do not slide meanwhile, unless there are equality constraints, which give way. Without this rule a
    light foot would slide, since the nearest place where it is closed may be far aside. Contacts are looked for up to a
    gap of ``reach`` at least, m, since surfaces may also recede.

    Raises:
        SolverError: the correction would move the bodies farther, in the kinetic norm, than they have moved in the
            phase, ``far``: points that are next to each other, like both faces of a foil, cannot be closed at once.
    """
    configuration, held = phase_end.now.configuration, phase_end.known[phase_end.sustained]
    for settling in range(_SETTLINGS):
        configuration.shift(shift)
        before, (now, known) = phase_end, detect_again(max(reach, phase_end.now.contact_set.opening(shift)))
        phase_end = PhaseEnd(now, known, among(known, held))
        table = _matched(table, before, phase_end)
        active = table[:, 0] > 0
        if np.abs(now.gap[active]).max(initial=0.0) <= CORRECTED * phase.tolerance:
            break
        rows = now.contact_set.rows.select(active)
        sticks = np.vecdot(table[:, 1:], table[:, 1:]) < (_STICKS * table[:, 0]) ** 2
        if settling >= _STICKING or now.contact_set.bilateral is not None:
            sticks[:] = False
        rows = Rows(*(part[(rows.kind == 0) | sticks[rows.contact]] for part in rows))
        wanted = np.where(rows.kind == 0, -now.gap[rows.contact], 0.0)
        z = np.linalg.lstsq(rows.whitened, wanted, rcond=_RANK)[0]
        p = np.linalg.lstsq(rows.whitened.T, z, rcond=_RANK)[0]  # the smallest one with Y Y^T p = wanted
        shift = configuration.jump(rows.jacobian, p)
        if configuration.kinetic_norm(shift) > far:
            raise SolverError(f"no small shift closes {np.count_nonzero(active)} contacts; use a smaller timestep")
    return phase_end, table


def _matched(table: np.ndarray, before: PhaseEnd, phase_end: PhaseEnd) -> np.ndarray:
    """Return impulses, (h, 6), of contacts found before, in the order of those found now.

    If several contacts on common faces continue the same one, an impulse goes to the nearest of them.
    """
    if np.array_equal(before.known, phase_end.known):
        return table
    result, now = np.zeros((len(phase_end.known), _KINDS)), phase_end.now.contacts.position
    for impulse, index, place in zip(table, before.known, before.now.contacts.position, strict=True):
        same = np.flatnonzero(phase_end.known == index) if index >= 0 else []
        if len(same):
            result[same[np.linalg.norm(now[same] - place, axis=1).argmin()]] += impulse
    return result


def _solve(phase_end: PhaseEnd, phase: Phase, free: np.ndarray, guess: np.ndarray) -> _Impulses:
    """Return the impulses of the sustained contacts, given a velocity without them, (nv,).

    The guess is of these contacts, (h, 6), or empty. What pushes there is held even if it is not quite closed.
    """
    now, known, before = phase_end.now, phase_end.known, phase.start.contact_forces
    guessed = len(guess) == len(now.gap)
    force = None if before is None else np.vstack([before.force, np.zeros(_KINDS)])  # the last row is for index -1
    held = now.closed | (guess[:, 0] > 0) if guessed else now.closed
    if phase.start.force is not None and force is not None:  # the force may have opened a contact of its own
        held = held | (force[known, 0] > 0)
    rows = now.contact_set.rows.select(phase_end.sustained & held)
    first = None
    if guessed:
        first = guess[rows.contact, rows.kind]
    elif force is not None:
        first = force[known[rows.contact], rows.kind] * phase.duration
    speed = now.configuration.kinetic_norm(free)
    impulse = solve_cone_rows(rows, rows.velocity(free), first, speed, phase.work, exact=phase.exact)
    table = np.zeros((len(now.gap), _KINDS))
    table[rows.contact, rows.kind] = impulse
    return _Impulses(rows, impulse, table)


def _turned(phase_end: PhaseEnd, phase: Phase, rows: Rows) -> np.ndarray | None:
    """Return the rows at the start of the phase minus the current rows, (n, nv); None if they are equal.

    Half of an impulse acts along the rows at the start (as in RATTLE), so that a body that turns about a sticking
    contact keeps its energy to second order.
    """
    start = phase.start.contact_forces
    if start is None or not len(start.rows.contact):
        return None
    before = start.rows
    place = np.full((len(phase.start.gap), _KINDS), -1)
    place[before.contact, before.kind] = np.arange(len(before.contact))
    known = phase_end.known[rows.contact]
    row = np.where(known >= 0, place[known, rows.kind], -1)
    start_rows = _unspun(phase_end, phase, rows, row, place)
    difference = np.where(row[:, None] >= 0, start_rows - rows.jacobian, 0.0)
    return turned_rows(phase_end.now.contact_set, difference, rows.whitened)


def _unspun(phase_end: PhaseEnd, phase: Phase, rows: Rows, row: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the rows at the start, (n, nv), with directions of friction that have not spun about the normal since.

    MuJoCo's directions spin if the normal turns, by an angle that depends on the orientation of the scene in the world.
    """
    assert phase.start.contact_forces is not None
    contact_set = phase_end.now.contact_set
    J = contact_set.carried(phase.start.contact_forces.rows.jacobian, phase.start.contact_set)
    friction = contact_set.pattern.friction
    normals = phase.start.contacts.normal[phase_end.known], phase_end.now.contacts.normal
    if friction is None or np.array_equal(*normals):
        return J[row]
    before, after = (contact_axes(normal)[1:] for normal in normals)
    along, across = (
        np.vecdot(after, before).sum(axis=0),
        np.vecdot(after[0], before[1]) - np.vecdot(after[1], before[0]),
    )
    mu = np.ones((len(along), _KINDS))
    mu[friction.contact, friction.kind + 1] = friction.coefficient
    i, other, sign = rows.contact, _OTHER[rows.kind], _SIGN[rows.kind]
    twin = place[phase_end.known[i], other]
    angle = np.where(twin >= 0, np.arctan2(across, along)[i], 0.0) * sign
    spun = np.sin(angle) * mu[i, rows.kind] / mu[i, other]
    return np.cos(angle)[:, None] * J[row] + spun[:, None] * J[twin]


def solve_cone_rows(
    rows: Rows, velocity: np.ndarray, guess: np.ndarray | None, speed: float, work: Work, *, exact: bool
) -> np.ndarray:
    """Return the impulses with E = 0, (n,); those of friction are divided by their coefficients."""
    count, sizes = len(rows.contact), rows.sizes
    work.solve(count, 0)
    problem = ConeProblem(rows.whitened, velocity, sizes, exact=exact, speed=speed)
    answer = solve_cones(problem, guess, rounds=work.rounds(count))
    work.solve(count, answer.iterations)
    if answer.status is not Status.SOLVED:
        raise SolverError(
            f"no impulses of {len(sizes)} contacts with friction were found: relative residual "
            f'{answer.residual / problem.scale:.1e}; use a smaller timestep, or friction="convex"'
        )
    return answer.impulse
