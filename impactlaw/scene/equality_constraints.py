"""Equality constraints of a scene: which of them an impact must not violate, and their gradients."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.tolerances import GIVEN_WAY, OWN_CONSTRAINT, WRITTEN
from impactlaw.solvers.least_squares import row_span

_CONNECT, _WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


TYING = 2
"""Kind of the equality constraints that tie two bodies to each other."""
CALM = 0.1
"""Part of the fastest collision up to which the velocity of an equality constraint is one that it can keep there."""
RESTING = 1e-9
"""The same where constraints that give way have driven a collision: those that are at rest but for rounding."""
DRIFT = 1e-3
"""Part of the fastest contact, in the kinetic metric, up to which a constraint that moves a gap is at rest."""
TIED = 0.2
"""What such constraints must leave of a gap gradient for contact to act: of how fast the gap opens next to the fastest
degree of freedom, in units of `lengths`. Where constraints have drifted, of the length of the gradient."""
SHIFTS = 3
"""How many rows of a connect or weld keep points together; others of a weld keep it from turning."""
_TORQUE, _LOOSE = 10, 0.3
"""Where a weld has its torquescale s among its numbers, and s below which it is a spring.

MuJoCo's constraints give way by about 0.1 / s^2 of what they hold."""


def constraint_kinds(model: mujoco.MjModel) -> np.ndarray:
    """Return 0 for equality constraints that an impact may violate, else 1, or `TYING`, uint8 (neq,)."""
    ties = (model.eq_type == _CONNECT) | (model.eq_type == _WELD)
    return np.where(bilateral_constraints(model), np.where(ties, TYING, 1), 0).astype(np.uint8)


def lengths(model: mujoco.MjModel) -> np.ndarray:
    """Return how far the bodies that each degree of freedom moves move with it, m per its unit, (nv,).

    It is the radius of gyration about a joint that turns them, and 1 where they are shifted.
    """
    return np.sqrt(model.dof_M0 / np.maximum(model.body_subtreemass[model.dof_bodyid], mujoco.mjMINVAL))


def bilateral_constraints(model: mujoco.MjModel) -> np.ndarray:
    """Return which equality constraints an impact must not violate, bool (neq,): all but those to mocap bodies.

    A constraint to a mocap body is a servo that drives what is held towards a target; it may lag behind. A weld that
    hardly turns what it holds, by a small torquescale, is a spring: it lets contact turn that.
    """
    kept = (model.eq_type != _WELD) | (model.eq_data[:, _TORQUE] >= _LOOSE)
    for i in range(model.neq):
        if model.eq_type[i] in (_CONNECT, _WELD):
            objects = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
            bodies = model.site_bodyid[objects] if model.eq_objtype[i] == _SITE else np.array(objects)
            kept[i] &= not (model.body_mocapid[model.body_rootid[bodies]] >= 0).any()
    return kept


def bilateral_rows(
    model: mujoco.MjModel, data: mujoco.MjData, kept: np.ndarray, *, calm: np.ndarray | None = None
) -> np.ndarray | None:
    """Return ``J_eq`` of the equality constraints that are kept and active, (m, nv), among the rows of now.

    Those that do not count are left out, see `rows_that_count`. Inertia must be current (`contacts.update_positions`).
    Rows that move against themselves faster than `calm`, m/s or rad/s, (ne,), are left out: they are giving way.
    """
    chosen = np.flatnonzero(kept[data.efc_id[: data.ne]])
    acts = np.ones(len(chosen), dtype=bool) if calm is None else np.abs(data.efc_vel[chosen]) <= calm[chosen]
    if not acts.any():
        return None
    J = _gradients(model, data, chosen)
    mujoco.mj_factorM(model, data)
    Y = np.empty_like(J)
    mujoco.mj_solveM2(model, data, Y, J, np.sqrt(data.qLDiagInv))
    return rows_that_count(model, data.efc_id[chosen], float(np.abs(data.efc_pos[chosen[acts]]).max()), J, Y, acts)


def rows_that_count(
    model: mujoco.MjModel, number: np.ndarray, given: float, J: np.ndarray, Y: np.ndarray, acts: np.ndarray
) -> np.ndarray | None:
    """Return rows that span those of equality constraints that count, (k, nv); None if there are none.

    MuJoCo's constraints are soft: where they have given way by a distance d, rows that depend on each other do so up
    to d over the size of the bodies only. Directions of that size are left out, or redundant constraints would lock a
    mechanism; then rows that span the others are returned. So are rows that short next to others of their constraint
    (`parts_of_longest`).

    Args:
        model: the scene.
        number: which constraint each row is of, all rows of some of them in MuJoCo's order, (m,).
        given: how far they have given way, m or rad.
        J: their gradients, (m, nv).
        Y: these where the kinetic metric is the Euclidean one, (m, nv).
        acts: which may count, bool (m,).
    """
    rank = min(max(GIVEN_WAY * given / model.stat.meansize, WRITTEN), OWN_CONSTRAINT)
    counting = acts & (parts_of_longest(model, number, J) > rank)
    J = np.ascontiguousarray(J[counting])
    if len(J) == 0:
        return None
    basis, combination = row_span(Y[counting], rank)
    return J if len(basis) == len(J) else combination @ J


def parts_of_longest(model: mujoco.MjModel, number: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return how long rows are, (m,), next to the longest of the same connect, or of shifts or turns of the same weld.

    The axes of hinges of a plane linkage are parallel up to the digits in which they are written, and up to what has
    given way: out of its plane such rows are next to nothing, and would lock it if they counted as others do. Where a
    part of a weld has no other rows, the longest of the weld decide.

    Args:
        model: the scene.
        number: see `rows_that_count`.
        J: see there.
    """
    size = np.linalg.norm(J / lengths(model), axis=1)
    _, first, of = np.unique(number, return_index=True, return_inverse=True)
    part = 2 * of + np.where(np.arange(len(number)) - first[of] < SHIFTS, 0, 1)
    longest, whole = np.zeros(2 * len(first)), np.zeros(len(first))
    np.maximum.at(longest, part, size)
    np.maximum.at(whole, of, size)
    reference = np.maximum(longest[part], WRITTEN * whole[of])
    ties = np.isin(model.eq_type[number], (_CONNECT, _WELD))
    return np.where(ties, size / np.where(reference > 0.0, reference, 1.0), size > 0.0)


def stiffness(model: mujoco.MjModel, data: mujoco.MjData, kept: np.ndarray) -> np.ndarray | None:
    """Return ``J_eq^T D J_eq``, (nv, nv), of the equality constraints that are kept and active, among the rows of now.

    ``D = 1 / R`` is MuJoCo's: a force f on the degrees of freedom accelerates them by ``(M + J_eq^T D J_eq)^-1 f`` more
    than they are accelerated without it, since the constraints give way a little. None if there are no such rows.
    """
    rows = np.flatnonzero(kept[data.efc_id[: data.ne]])
    if len(rows) == 0:
        return None
    J = _gradients(model, data, rows)
    return J.T @ (data.efc_D[rows, None] * J)


def _gradients(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
    """Return rows of MuJoCo's constraint Jacobian, dense, (k, nv)."""
    J, unit = np.empty((len(rows), model.nv)), np.zeros(data.nefc)
    for out, row in zip(J, rows, strict=True):
        unit[row] = 1.0
        mujoco.mj_mulJacTVec(model, data, out, unit)
        unit[row] = 0.0
    return J


def are_tied(gradients: np.ndarray, constraints: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return of which gap gradients, (h, nv), constraints, (m, nv), leave next to nothing, bool (h,).

    See `stepping.compiled.ties`; `lengths` are those of `lengths`. Constraints are those of `bilateral_rows`.
    """
    basis, _ = row_span(constraints / lengths, OWN_CONSTRAINT)
    scaled = gradients / lengths
    left = scaled - scaled @ basis.T @ basis
    # not next to all that moves: of 30 bodies welded to each other, the one that touches is a small part
    fastest = np.abs(left).max(axis=1, initial=0.0) * np.abs(scaled).max(axis=1, initial=0.0)
    return np.vecdot(left, left) <= TIED * fastest
