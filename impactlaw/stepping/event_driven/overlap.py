"""Refuse or push out overlapping geoms, and joints and tendons beyond limits, at the start of rigid stepping.

Rigid contacts never overlap by themselves; an overlap was set from outside, by a reset or by hand. To push it out means
to move the configuration q once, by the smallest shift d in the kinetic metric that opens all gaps,

    min d^T M d,   gap(q + d) >= 0.

It is found by Gauss-Newton on the gaps, with M at the configuration reached so far. If contacts jump between points of
faces, so that the iteration does not settle, the remaining overlap is opened by the smallest shift from there. Bodies
share a shift by their inertia, as they would share an impulse. Equality constraints keep their violation to first
order. Velocities stay the same.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.errors import OverlapError, UnfinishedStepError, UnsolvableLawError
from impactlaw.solvers import Problem, solve_with_jump
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import CORRECTED, ContactState
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

_SHIFTS = 100  # largest number of corrections of the shift
_SMALLEST = 40  # number of corrections that look for the smallest shift; the others only open the remaining overlap
_SETTLED = 1e-6  # change of the shift by a correction, relative to the shift, below which it has settled
_FAR = 1e3  # largest shift of bodies, relative to the depth of the deepest overlap
_TURNS = 2.0 * np.pi  # largest rotation by a shift, beyond that which opens violated limits, rad
_NAMED = 5  # number of overlaps that an error names
_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_SINGLE = int(mujoco.mjtJoint.mjJNT_HINGE), _SLIDE
_ROUNDED = int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD)  # their points have single precision
_ROUNDING = 2.0**-24  # rounding of these points, relative to the size of the geom


def clearance(contact_set: ContactSet) -> np.ndarray:
    """Return the distances of surfaces, (h,): the gaps plus the skin within which contacts count as touching."""
    gap, skin = contact_set.gap, contact_set.pattern.skin
    return gap if skin is None else gap + skin


def _allowed(contact_set: ContactSet, tolerance: float) -> np.ndarray | float:
    """Return the largest depth that is no overlap, m or rad, (h,): the gap tolerance plus the rounding of meshes."""
    model, geoms = contact_set.configuration.model, contact_set.contacts.geoms
    if not model.nmesh and not model.nhfield:
        return tolerance
    size = np.where(np.isin(model.geom_type, _ROUNDED), model.geom_rbound, 0.0)
    return tolerance + _ROUNDING * np.where(geoms < 0, 0.0, size[geoms]).sum(axis=1)


def overlaps(contact_set: ContactSet, tolerance: float) -> bool:
    """Return whether a contact overlaps by more than the gap tolerance, m or rad, and the rounding of meshes."""
    return bool(np.count_nonzero(clearance(contact_set) < -_allowed(contact_set, tolerance)))


def refuse(contact_set: ContactSet, tolerance: float, reason: str) -> OverlapError:
    """Return the error that names the overlaps, the deepest first."""
    contacts, depth = contact_set.contacts, -clearance(contact_set)
    deep = np.flatnonzero(depth > _allowed(contact_set, tolerance))
    deep = deep[np.argsort(-depth[deep])]
    units = np.where(contacts.geoms[:, 0] < 0, "beyond the limit", "m")
    named = ", ".join(f"{contacts.labels[i]} by {depth[i]:.3g} {units[i]}" for i in deep[:_NAMED])
    return OverlapError(f"geoms overlap at the start of a step: {named}; {reason}")


def push_out(phases: SmoothPhases, start: ContactState) -> ContactState:
    """Move the scene by the smallest shift that opens all gaps; return the contacts after it.

    If none is found, joints beyond their limits are put back to their limits, if that opens all gaps.

    Raises:
        OverlapError: bodies are squeezed: no shift opens all gaps, or none was found. data.qpos may have changed.
        UnfinishedStepError: looking for a shift takes too much work.
    """
    configuration = phases.configuration
    qpos = configuration.data.qpos.copy()
    try:
        return _smallest_shift(phases, start)
    except (OverlapError, UnfinishedStepError):
        configuration.data.qpos[:] = qpos
        _put_back(configuration)
        now = phases.look()
        if overlaps(now.contact_set, phases.tolerance):
            raise
        return now


def open_jump(phases: SmoothPhases, start: ContactState) -> ContactState:
    """Open an overlap that is due to a jump of a gap; leave it if bodies are squeezed; return the contacts after it.

    Bodies count as squeezed, too, if opening would move them by far more than they overlap: constraints then leave them
    almost no motion in that direction.
    """
    configuration, depth = phases.configuration, -float(start.gap.min())
    state, before = configuration.save(), configuration.data.geom_xpos.copy()
    try:
        found = push_out(phases, start)
        if np.abs(configuration.data.geom_xpos - before).max(initial=0.0) <= _FAR * depth:
            return found
    except (OverlapError, UnfinishedStepError):
        pass
    configuration.restore(state)
    return phases.look()


def _put_back(configuration: Configuration) -> None:
    """Put hinges and slides that are beyond their limits back to the limits."""
    model, qpos = configuration.model, configuration.data.qpos
    joints = np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, _SINGLE))
    where, (low, high) = model.jnt_qposadr[joints], model.jnt_range[joints].T
    qpos[where] = np.clip(qpos[where], low, high)
    configuration.update()


def _smallest_shift(phases: SmoothPhases, start: ContactState) -> ContactState:
    """Find and apply the smallest shift, see `push_out`, by Gauss-Newton on the gaps."""
    configuration, nv = phases.configuration, phases.configuration.model.nv
    qpos, reach = configuration.data.qpos.copy(), 2.0 * float(-start.gap.min())
    now, shift, allowed = phases.look(reach), np.zeros(nv), CORRECTED * phases.tolerance
    for correction in range(_SHIFTS):
        phases.work.look(len(now.gap))
        phases.work.hold(len(now.gap))
        contact_set, gap, last = now.contact_set, now.gap, correction >= _SMALLEST
        if not len(gap) or (last and gap.min() >= -allowed):  # or pushed out further than contacts are looked for
            return now
        if last:
            qpos, shift = configuration.data.qpos.copy(), np.zeros(nv)
        try:
            wanted = _shift(contact_set, contact_set.jacobian.dot(shift) - gap)
        except UnsolvableLawError:
            break
        change = wanted - shift
        settled = np.abs(change).max() <= _SETTLED * np.abs(wanted).max()
        if settled and gap.min() >= -allowed and contact_set.opening(change) <= allowed:
            return now
        if _is_far(configuration.model, wanted, reach):
            break
        shift = wanted
        configuration.shift(shift, qpos=qpos)
        now = phases.look(reach)
    if overlaps(now.contact_set, phases.tolerance):
        reason = "bodies are squeezed there: no shift was found that opens all gaps"
        raise refuse(start.contact_set, phases.tolerance, reason)
    return now


def _is_far(model: mujoco.MjModel, shift: np.ndarray, reach: float) -> bool:
    """Return whether a shift, (nv,), is far larger than the overlaps: then constraints all but prevent opening them."""
    joint = model.jnt_type[model.dof_jntid]
    first = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    moves = (joint == _SLIDE) | ((joint == _FREE) & (first < 3))
    return bool((np.abs(shift) > np.where(moves, _FAR * reach, _TURNS + reach)).any())


def _shift(contact_set: ContactSet, least: np.ndarray) -> np.ndarray:
    """Return the shift d with ``J d >= least`` and smallest ``d^T M d``, (nv,)."""
    J, Y = contact_set.confined
    solution = solve_with_jump(Problem(Y, least), ("",) * len(least), shared=False)
    return contact_set.configuration.jump(J, solution.impulse)
