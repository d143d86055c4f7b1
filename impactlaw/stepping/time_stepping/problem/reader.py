"""Read the rows of a step from MuJoCo's arrays, with the velocities of moving surfaces."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled, for_python
from impactlaw.scene.equality_constraints import constraint_kinds, least_free, lengths
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.solvers.cones.algebra.loops import cleared, numbers
from impactlaw.stepping.compiled.dense import sparse_jacobian
from impactlaw.stepping.compiled.left_out.tied_contacts import find_tied
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.problem.detection.carriers import add_carried
from impactlaw.stepping.time_stepping.problem.rows import (
    Rows,
    Source,
    count_groups,
    entries_of,
    find_near,
    write_rows,
)


@compiled()
def _read_rows(source, inertia, trees, before, free, near, timestep, frictional, touching):
    """Return the rows that `write_rows` writes; see there."""
    mark = cleared(len(trees[1]))
    groups, count = count_groups(source.kinds, source.number, source.dim, source.friction, near, frictional)
    entries = entries_of(source.jacobian, trees, mark)
    rows = Rows(
        np.empty((3, count), np.int32), np.empty(entries, np.int32), np.empty(entries), np.empty((4, groups), np.int32),
        np.empty(groups, np.int64), np.empty((2, groups)), np.empty((7, count)),
    )  # fmt: skip
    room = numbers(2 * len(before))
    end = write_rows(source, inertia, trees, before, free, near, timestep, frictional, touching, mark, room, rows)
    return Rows(
        rows.sparse, rows.colind[:end], rows.value[:end], rows.groups, rows.key, rows.amounts, rows.rates
    )  # fmt: skip


def read_rows(
    model: mujoco.MjModel, data: mujoco.MjData, metric: Inertia, start: np.ndarray, free: np.ndarray, near: np.ndarray,
    *, belts: bool = True, frictional: bool = True, touching: float = 0.0,
) -> Rows:  # fmt: skip
    """Return the rows of data's current contacts whose groups are near.

    Args:
        model: the scene.
        data: the state with current contacts and constraints.
        metric: the mass matrix of the step.
        start: velocity at the start of the step, (nv,).
        free: velocity without contact, (nv,).
        near: rows of MuJoCo that begin a group that takes part, bool (nefc,).
        belts: whether velocities of belts count.
        frictional: whether rows of friction take part.
        touching: gap, m or rad, up to which bodies at rest touch.
    """
    found, trees = data.contact, (model.dof_treeid, model.tree_dofadr, model.tree_dofnum)
    source = Source(
        data.efc_type, data.efc_id, data.efc_pos, data.efc_vel if belts else data.efc_vel[:0], data.efc_aref,
        data.efc_R, data.efc_frictionloss, sparse_jacobian(model, data),
        *(np.ascontiguousarray(array) for array in (found.dim, found.geom, found.friction)),
    )  # fmt: skip
    return _read_rows(source, metric, trees, start, free, near, model.opt.timestep, frictional, touching)


class RowReader:
    """Reads the contacts and limits that MuJoCo has found in the middle of a step.

    Args:
        model: the scene.
        surfaces: surfaces that move during the step; None if there are none.
        frictional: whether rows of friction take part.
        touching: gap, m or rad, up to which bodies at rest touch.
    """

    def __init__(self, model: mujoco.MjModel, surfaces: Surfaces | None, *, frictional: bool, touching: float):
        self._model, self._surfaces, self.frictional, self._touching = model, surfaces, frictional, touching
        self._constraints, self._lengths = constraint_kinds(model), lengths(model)

    def near(self, data: mujoco.MjData, one: np.ndarray, other: np.ndarray, reach: float) -> np.ndarray:
        """Return which rows begin a contact or limit that is closed or would soon be, bool (nefc,).

        Args:
            data: the state with current contacts.
            one: a velocity, (nv,).
            other: another velocity; a contact is near if either velocity closes it.
            reach: time within which it would close, s.
        """
        jacobian, address = sparse_jacobian(self._model, data), data.contact.efc_address
        near = np.empty(data.nefc, dtype=bool)
        if self._surfaces is not None and self._surfaces.move:  # surfaces come near to bodies that do not move
            near[:] = True
        else:
            for_python(find_near)(data.efc_type, data.efc_pos, jacobian, address, one, other, reach, near)
        return self.without_tied(data, near)

    def without_tied(self, data: mujoco.MjData, near: np.ndarray) -> np.ndarray:
        """Return which rows are near, bool (nefc,), without those that `compiled.left_out.tied_contacts` finds tied."""
        if data.ne and data.ncon:
            address = data.contact.efc_address
            jacobian = sparse_jacobian(self._model, data)
            tied, paired = np.zeros((2, len(address)), dtype=bool)
            for_python(find_tied)(
                data.efc_type, data.efc_id, self._constraints, jacobian, self._lengths, np.ascontiguousarray(address),
                paired, least_free(self._model, data.contact.geom), tied,
            )  # fmt: skip
            near[address[tied]] = False
        return near

    def read(self, data: mujoco.MjData, near: np.ndarray, start: np.ndarray, free: np.ndarray, metric: Inertia) -> Rows:
        """Return the rows of the groups that are near.

        Args:
            data: the state with current contacts.
            near: see `near`.
            start: velocity at the start of the step, (nv,).
            free: velocity without contact, (nv,).
            metric: the mass matrix of the step.
        """
        rows = read_rows(
            self._model, data, metric, start, free, near, frictional=self.frictional, touching=self._touching
        )
        if self._surfaces is not None and self._surfaces.move:
            model, found = self._model, data.contact
            contacts = found.pos, found.frame, found.geom, found.efc_address
            bodies = model.geom_bodyid, model.body_rootid, model.body_mocapid
            for_python(add_carried)(rows, contacts, bodies, data.mocap_pos, self._surfaces.middle_velocity)
        return rows
