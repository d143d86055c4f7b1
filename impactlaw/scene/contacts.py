"""Contacts, gap gradients and the mass matrix, read from MuJoCo's arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import mujoco
import numpy as np

from impactlaw.errors import SceneError
from impactlaw.scene.corrected.hidden_edges import hide_edges
from impactlaw.scene.tolerances import NO_LEVER, ON_AXIS, OUT_OF_REACH, SHORT

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_FIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
_FEW = 8  # number of contacts up to which one gradient after another is faster than all at once
_EULER, _DISCRETE = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_DISCRETE)


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts between pairs of geoms, ordered by geom ids, followed by limits of joints and tendons that are near.

    With this order the contacts of a chain of bodies are in the order of the chain.

    Attributes:
        labels: ``"first/second"`` per contact: the names of the two geoms, or of their bodies if geoms have no name;
            the name of the joint or tendon for a limit.
        geoms: geom ids, the lower one first, int (h, 2); -1 for a limit.
        gap: signed distance, m, (h,), less the 1e-6 m at which geoms touch that MuJoCo measures by its general convex
            collider; for a limit the distance from it, m or rad.
        position: midway between the two surfaces, world frame, m, (h, 3), or on that of a body in contact with one that
            cannot move (time stepping, soft steps with friction); for a limit the anchor of the joint, zero for a
            tendon.
        normal: unit vector from the first geom to the second, world frame, (h, 3); for a limit the axis of the joint,
            pointing away from the limit, zero for a tendon.
    """

    labels: tuple[str, ...]
    geoms: np.ndarray
    gap: np.ndarray
    position: np.ndarray
    normal: np.ndarray

    def __len__(self) -> int:
        return len(self.gap)

    def select(self, which: np.ndarray) -> Contacts:
        """Return the contacts of a boolean mask, (h,), or an index array, (k,)."""
        index = np.flatnonzero(which) if which.dtype == bool else which
        return Contacts(
            tuple(self.labels[i] for i in index),
            self.geoms[index],
            self.gap[index],
            self.position[index],
            self.normal[index],
        )

    def followed_by(self, others: Contacts) -> Contacts:
        """Return these contacts, then others."""
        fields = ("geoms", "gap", "position", "normal")
        parts = [np.concatenate([getattr(self, name), getattr(others, name)]) for name in fields]
        return Contacts(self.labels + others.labels, *parts)


_sizes = attrgetter(
    "nq", "nv", "na", "nu", "nbody", "njnt", "ngeom", "nsite", "nmocap", "neq", "ntendon", "nsensordata", "ntree", "nM",
    "nC", "nD", "nJmom", "nwrap", "nuserdata",
)  # fmt: skip


def is_data_of(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether data belong to a model, or to one with the same bodies, joints and geoms.

    MuJoCo's signatures are compared. Models from a binary file or a pickle have no signature; their sizes are compared.
    """
    signature, own = data.signature, model.signature
    if signature != 0 and own != 0:
        return signature == own
    return data.model is model or _sizes(data.model) == _sizes(model)


def geom_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the name of each geom in contact labels: its own name, that of its body, or ``geom<id>``."""
    names = []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom])
        names.append(model.geom(geom).name or (body.name if body.id else "") or f"geom{geom}")
    return tuple(names)


def update_positions(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Update frames, inertia and everything else that gap gradients need to data.qpos."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    if model.ntendon:
        mujoco.mj_tendon(model, data)
    mujoco.mj_makeM(model, data)


def _hidden(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return which of MuJoCo's contacts the plane of a closed one hides, bool (ncon,); see `hide_edges`."""
    found, out = data.contact, np.zeros(data.ncon, dtype=bool)
    which = _on_pieces(model, found.geom)
    if len(which):
        gap, room = found.dist[which], np.empty(2 * model.ngeom + len(which), dtype=int)
        shapes = model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat
        bodies, at = (model.geom_bodyid, model.body_weldid, model.body_treeid), (model, data)
        hide_edges(gap, found.pos[which], found.frame[which], found.geom[which], *bodies, shapes, at, room)
        out[which] = gap == OUT_OF_REACH
    return out


def _on_pieces(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return the indices of the contacts, (ncon, 2), of moving geoms with several fixed ones or a height field."""
    fixed = model.body_treeid[model.geom_bodyid[geoms]] < 0
    which = np.flatnonzero((fixed[:, 0] != fixed[:, 1]) & (geoms >= 0).all(axis=1))
    pairs, own = geoms[which], fixed[which, 0].astype(int)  # the place of the geom that moves
    mover, floor = pairs[np.arange(len(which)), own], pairs[np.arange(len(which)), 1 - own]
    last, several = np.empty(model.ngeom, dtype=int), np.zeros(model.ngeom, dtype=bool)
    last[mover] = floor
    several[mover[(last[mover] != floor) | (model.geom_type[floor] == _FIELD)]] = True
    return which[several[mover]]


def acted_on(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the indices of the contacts that have rows in MuJoCo's constraint solver now, in order of geoms, int (h,).

    Contacts of flexes are left to MuJoCo, and those with edges that others hide, see `_hidden`.
    """
    found = data.contact
    index = np.flatnonzero((found.efc_address >= 0) & (found.geom >= 0).all(axis=1))
    index = index[sorted_geoms(found.geom[index])[1]]
    return index if len(index) < 2 else index[~_hidden(model, data)[index]]


def first_rows(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return MuJoCo's first row of each contact that is `acted_on`, followed by those of limits, int (h,)."""
    return np.concatenate([data.contact.efc_address[acted_on(model, data)], data.ne + data.nf + np.arange(data.nl)])


def active_contacts(model: mujoco.MjModel, data: mujoco.MjData, names: tuple[str, ...]) -> Contacts:
    """Return the contacts that are `acted_on`, as found by MuJoCo's position stage."""
    found, index = data.contact, acted_on(model, data)
    geoms, _, swapped = sorted_geoms(found.geom[index])  # their order is that of `index`
    normal = found.frame[index, :3]
    normal[swapped] *= -1.0
    return Contacts(contact_labels(geoms, names), geoms, found.dist[index], found.pos[index], normal)


def closes(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray, speed: float) -> bool:
    """Return whether a contact or limit in MuJoCo's solver closes faster than ``speed``, m/s or rad/s.

    With pyramidal cones the normal row is the mean of the first two rows of a contact. Plain Python numbers are faster
    here than arrays for up to dozens of contacts, and their cost per contact is small next to that of MuJoCo's step.
    """
    if not len(rows) or not rows.item(rows.argmin()) < -speed:  # the minimum over all rows is a bound
        return False
    limits = data.nl
    if limits == len(rows):
        return True
    first = data.ne + data.nf
    values = rows[first:].tolist()
    if limits and min(values[:limits]) < -speed:
        return True
    if not data.ncon:
        return False
    found, pyramidal = data.contact, model.opt.cone == _PYRAMIDAL
    for address, dim in zip(found.efc_address.tolist(), found.dim.tolist(), strict=True):
        if address >= 0:
            row = address - first
            normal = 0.5 * (values[row] + values[row + 1]) if pyramidal and dim > 1 else values[row]
            if normal < -speed:
                return True
    return False


def _dense_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return a view of MuJoCo's dense Jacobian, (nefc, nv), whose buffer may be larger."""
    return data.efc_J.reshape(-1)[: data.nefc * model.nv].reshape(data.nefc, model.nv)


def constraint_rows(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
    """Return rows of the Jacobian of MuJoCo's current constraints, dense, (k, nv)."""
    if not mujoco.mj_isSparse(model):
        return _dense_jacobian(model, data)[rows]
    J, nnz, adr = np.zeros((len(rows), model.nv)), data.efc_J_rownnz, data.efc_J_rowadr
    values, columns = data.efc_J.reshape(-1), data.efc_J_colind.reshape(-1)
    for out, row in zip(J, rows.tolist(), strict=True):
        entries = slice(adr[row], adr[row] + nnz[row])
        out[columns[entries]] = values[entries]
    return J


def row_velocities(model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
    """Return the velocities, (nefc,), that MuJoCo's current constraint rows would have at another qvel, (nv,)."""
    rows = np.empty(data.nefc)
    mujoco.mj_mulJacVec(model, data, rows, velocity)
    return rows


def sorted_geoms(geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sorted pairs of geom ids, lower one first, the indices that sort them, and which pairs were swapped."""
    if (geoms < 0).any():
        raise SceneError("a flex is in contact; an impact law is for contacts between geoms only")
    order = np.lexsort((geoms.max(axis=1), geoms.min(axis=1)))
    geoms = np.array(geoms[order], dtype=int)
    swapped = geoms[:, 0] > geoms[:, 1]
    geoms[swapped] = geoms[swapped, ::-1]
    return geoms, order, swapped


def contact_labels(geoms: np.ndarray, names: Sequence[str]) -> tuple[str, ...]:
    """Return ``"first/second"`` for each pair of geom ids."""
    return tuple(f"{names[a]}/{names[b]}" for a, b in geoms)


def make_rows(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray | None:
    """Make constraint rows and return the gap gradients of data.contact, in its order, (h, nv).

    The result is None if MuJoCo makes no row for a contact. Besides contacts only equality constraints and limits may
    be on, and the Jacobian must be dense (`BorrowedOptions`). Call `forget_rows` afterwards.
    """
    contact, h, integrator = data.contact, data.ncon, model.opt.integrator
    try:
        if integrator == _DISCRETE:
            model.opt.integrator = _EULER  # MuJoCo makes no ``efc_D`` at this stage otherwise
        mujoco.mj_makeConstraint(model, data)
        if data.nefc != data.ne + data.nl + h:
            dim = contact.dim.copy()
            contact.dim[:] = 1  # a frictionless contact has one row
            contact.exclude[:] = 0  # include contacts within a detection gap
            mujoco.mj_makeConstraint(model, data)
            contact.dim[:] = dim
    finally:
        if integrator == _DISCRETE:
            model.opt.integrator = integrator
    if h == 0:
        return np.zeros((0, model.nv))
    first = data.ne + data.nl
    return _dense_jacobian(model, data)[first:].copy() if data.nefc == first + h else None


def forget_rows(data: mujoco.MjData) -> None:
    """Remove the constraint rows from data, since they have no forces yet."""
    data.contact.efc_address[:] = -1
    data.nefc = data.nl = data.ne = 0


def gap_gradients(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> np.ndarray:
    """Return ``J``, shape (h, nv): rows give the velocity of the second body relative to the first, along the normal.

    A row that is only rounding is set to 0, as where the normal meets the axes of all joints between the bodies; it
    would allow huge impulses otherwise.
    """
    if len(contacts) <= _FEW:
        return _gradients_one_by_one(model, data, contacts)
    first, second = _moved_by(model, model.geom_bodyid[contacts.geoms]).transpose(1, 0, 2)
    normal, J = contacts.normal, np.zeros((len(contacts), model.nv))
    root = model.body_rootid[model.dof_bodyid]
    for tree in np.unique(root).tolist():  # MuJoCo's motion axes of a tree pass through its center of mass
        dofs = np.flatnonzero(root == tree)
        lever = np.cross(contacts.position - data.subtree_com[tree], normal)
        J[:, dofs] = normal @ data.cdof[dofs, 3:].T + lever @ data.cdof[dofs, :3].T
    J *= second.astype(float) - first  # bodies on both sides that move with a joint cancel exactly
    short = np.flatnonzero(np.vecdot(J, J) <= SHORT**2)
    J[short] = _gradients_one_by_one(model, data, contacts.select(short))
    return J


def _moved_by(model: mujoco.MjModel, bodies: np.ndarray) -> np.ndarray:
    """Return which degrees of freedom move each of the bodies, given by their ids, bool (*bodies.shape, nv)."""
    unique, which = np.unique(bodies, return_inverse=True)
    moved = np.zeros((len(unique), model.nv), dtype=bool)
    for row, body in zip(moved, model.body_weldid[unique].tolist(), strict=True):
        dof = model.body_dofadr[body] + model.body_dofnum[body] - 1 if body else -1
        while dof >= 0:
            row[dof] = True
            dof = model.dof_parentid[dof]
    return moved[which].reshape(*bodies.shape, model.nv)


def _gradients_one_by_one(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> np.ndarray:
    J = np.zeros((len(contacts), model.nv))
    point = np.zeros((3, model.nv))
    weld = model.body_weldid
    for row, geoms, position, normal in zip(J, contacts.geoms, contacts.position, contacts.normal, strict=True):
        bodies, relative = model.geom_bodyid[geoms], np.zeros((3, model.nv))
        for sign, body in zip((-1.0, 1.0), bodies, strict=True):
            if weld[body] != 0:
                mujoco.mj_jac(model, data, point, None, position, body)
                relative += sign * point
        row[:] = normal @ relative
        lengths = max(np.abs(position).max(), np.abs(data.xpos[bodies]).max())
        rounding = max(ON_AXIS * lengths, NO_LEVER * np.abs(relative).max(initial=0.0))
        if np.abs(row).max(initial=0.0) <= rounding:
            row[:] = 0.0
    return J


def some_short(J: np.ndarray) -> bool:
    """Return whether a row of J may be only rounding, see `gap_gradients`."""
    return min(np.vecdot(J, J).tolist(), default=1.0) <= SHORT**2


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return ``M`` at the current frames (`update_positions`), (nv, nv)."""
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M
