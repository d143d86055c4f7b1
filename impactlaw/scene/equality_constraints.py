"""Equality constraints of a scene: those that an impact must not violate, and their gradients."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.contacts import constraint_rows
from impactlaw.scene.tolerances import GIVEN_WAY, OWN_CONSTRAINT, WRITTEN
from impactlaw.solvers.least_squares import row_span
from impactlaw.solvers.sparsity import components

_CONNECT, _WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


TYING = 2
"""Kind of the equality constraints that tie two bodies to each other."""
CALM = 0.1
"""Velocity of an equality constraint, relative to the fastest collision, up to which it is kept in the collision."""
RESTING = 1e-9
"""The same limit where constraints that give way have driven a collision: only those at rest, up to rounding, stay."""
DRIFT = 1e-3
"""Velocity of a constraint that moves a gap that counts as 0, relative to the fastest contact in the kinetic metric."""
TIED, STOPPED = 0.2, 0.02
"""Part of a gap gradient that such constraints must leave free for the contact to act; the second for contact with what
stands still, such as the stop of a piston next to its dead centre. It is measured by how fast the gap opens next to the
fastest degree of freedom, in units of `lengths`."""
HELD_BY_DRIFT = 0.2
"""Part of the length of a gap gradient up to which constraints that have drifted leave the contact no motion."""
SHIFTS = 3
"""Number of rows of a connect or weld that keep points together; further rows of a weld keep it from turning."""
_TORQUE, _LOOSE = 10, 0.3
"""Index of the torquescale s of a weld in ``eq_data``, and the s below which the weld is a spring.

MuJoCo's constraints give way by about 0.1 / s^2 of what they hold."""


def constraint_kinds(model: mujoco.MjModel) -> np.ndarray:
    """Return 0 for equality constraints that an impact may violate, `TYING` for those that tie bodies, else 1, (neq,).

    The type is uint8.
    """
    ties = (model.eq_type == _CONNECT) | (model.eq_type == _WELD)
    return np.where(bilateral_constraints(model), np.where(ties, TYING, 1), 0).astype(np.uint8)


def lengths(model: mujoco.MjModel) -> np.ndarray:
    """Return how far bodies move per unit of each degree of freedom, m per m or rad, (nv,).

    It is the radius of gyration about a joint that turns the bodies, and 1 for a translation.
    """
    return np.sqrt(model.dof_M0 / np.maximum(model.body_subtreemass[model.dof_bodyid], mujoco.mjMINVAL))


def bilateral_constraints(model: mujoco.MjModel) -> np.ndarray:
    """Return which equality constraints an impact must not violate, bool (neq,).

    These are all but two kinds. A constraint to a mocap body is a servo that drives a body towards a target, and may
    lag behind. A weld with a small torquescale is a spring that lets contacts turn the body it holds.
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
    """Return ``J_eq`` of the equality constraints that are kept and active, (m, nv), from MuJoCo's current rows.

    Rows that do not count are left out, see `rows_that_count`. So are rows whose constraint velocity exceeds `calm`,
    m/s or rad/s, (ne,), since they are giving way. Inertia must be current (`contacts.update_positions`).
    """
    chosen = np.flatnonzero(kept[data.efc_id[: data.ne]])
    acts = np.ones(len(chosen), dtype=bool) if calm is None else np.abs(data.efc_vel[chosen]) <= calm[chosen]
    if not acts.any():
        return None
    J = constraint_rows(model, data, chosen)
    mujoco.mj_factorM(model, data)
    Y = np.empty_like(J)
    mujoco.mj_solveM2(model, data, Y, J, np.sqrt(data.qLDiagInv))
    return rows_that_count(model, data.efc_id[chosen], float(np.abs(data.efc_pos[chosen[acts]]).max()), J, Y, acts)


def rows_that_count(
    model: mujoco.MjModel, number: np.ndarray, given: float, J: np.ndarray, Y: np.ndarray, acts: np.ndarray
) -> np.ndarray | None:
    """Return rows with the same span as the rows of equality constraints that count, (k, nv); None if there are none.

    MuJoCo's constraints are soft. Where they have given way by a distance d, rows that would be linearly dependent are
    so only up to d over the size of the bodies. Directions with singular values of that size are left out, since
    redundant constraints would lock a mechanism otherwise. Rows that are as short next to the others of their
    constraint (`parts_of_longest`) are left out, too.

    Args:
        model: the scene.
        number: the constraint of each row, (m,); all rows of a constraint are there, in MuJoCo's order.
        given: how far the constraints have given way, m or rad.
        J: their gradients, (m, nv).
        Y: the gradients in coordinates in which the kinetic metric is the Euclidean one, (m, nv).
        acts: which rows may count, bool (m,).
    """
    rank = min(max(GIVEN_WAY * given / model.stat.meansize, WRITTEN), OWN_CONSTRAINT)
    counting = acts & (parts_of_longest(model, number, J) > rank)
    J = np.ascontiguousarray(J[counting])
    if len(J) == 0:
        return None
    basis, combination = row_span(Y[counting], rank)
    return J if len(basis) == len(J) else combination @ J


def parts_of_longest(model: mujoco.MjModel, number: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return the length of each row, (m,), relative to the longest of its connect, or of its part of a weld.

    The parts of a weld are its translational and its rotational rows. The hinge axes of a planar linkage are parallel
    only up to the digits in which they are written and up to how far constraints have given way. Rows out of its plane
    are therefore tiny, and would lock the linkage if they counted like the others. If all rows of a part of a weld are
    tiny, the longest row of the whole weld is the reference.

    Args:
        model: the scene.
        number: see `rows_that_count`.
        J: see `rows_that_count`.
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
    """Return ``J_eq^T D J_eq``, (nv, nv), of the equality constraints that are kept and active; None if there are none.

    ``D = 1 / R`` is MuJoCo's. Since the constraints give way a little, a force f on the degrees of freedom changes
    their acceleration by ``(M + J_eq^T D J_eq)^-1 f``.
    """
    rows = np.flatnonzero(kept[data.efc_id[: data.ne]])
    if len(rows) == 0:
        return None
    J = constraint_rows(model, data, rows)
    return J.T @ (data.efc_D[rows, None] * J)


def closing_beside(constraints: np.ndarray, gradients: np.ndarray, closing: np.ndarray, tree: np.ndarray) -> np.ndarray:
    """Return the largest closing speed of the contacts next to each equality constraint, m/s or rad/s, (m,).

    A contact is next to a constraint if both move the same tree of bodies, or trees that further ones connect.

    Args:
        constraints: gradients of the constraints, (m, nv).
        gradients: gap gradients of the contacts, (k, nv).
        closing: closing speeds of the contacts, 0 or more, m/s or rad/s, (k,).
        tree: the tree of each degree of freedom, ``model.dof_treeid``, (nv,).
    """
    moved = (np.concatenate([constraints, gradients]) != 0.0) @ (tree[:, None] == np.unique(tree))
    fastest = np.concatenate([np.zeros(len(constraints)), closing])
    for group in components(moved @ moved.T):
        fastest[group] = fastest[group].max()
    return fastest[: len(constraints)]


def least_free(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return `STOPPED` or `TIED` for contacts between geoms, (h, 2), -1 where there is none; shape (h,)."""
    still = (geoms >= 0) & (model.body_treeid[model.geom_bodyid[geoms]] < 0)
    return np.where(still.any(axis=1), STOPPED, TIED)


def are_tied(gradients: np.ndarray, constraints: np.ndarray, lengths: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return which gap gradients, (h, nv), are almost entirely fixed by constraints, (m, nv), bool (h,).

    See `stepping.compiled.left_out.tied_contacts`. ``lengths`` and ``least`` come from the functions `lengths` and
    `least_free`, ``constraints`` from `bilateral_rows`.
    """
    basis, _ = row_span(constraints / lengths, OWN_CONSTRAINT)
    scaled = gradients / lengths
    left = scaled - scaled @ basis.T @ basis
    # not relative to all that moves: of 30 bodies welded to each other, the one in contact is a small part
    fastest = np.abs(left).max(axis=1, initial=0.0) * np.abs(scaled).max(axis=1, initial=0.0)
    return np.vecdot(left, left) <= least * fastest
