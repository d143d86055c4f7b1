"""The contacts that a step has seen, kept for laws, events and other readers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction
from impactlaw.scene.contacts import Contacts, contact_labels
from impactlaw.scene.equality_constraints import rows_that_count
from impactlaw.scene.joint_limits import NO_GEOM, Limits, LimitState
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.problem.energy import islands_of
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.problem.targets import reached_groups

_ROUNDING = 1e-12


def in_order(rows: Rows, chosen: np.ndarray) -> np.ndarray:
    """Return the groups of a mask, bool (g,), sorted: contacts by their geoms, then limits, int (k,)."""
    groups = np.flatnonzero(chosen)
    return groups[np.lexsort((rows.key[groups], rows.source[groups] < 0))]


@dataclass(frozen=True, eq=False)
class ContactSnapshot:
    """Copies of contacts, rows and inertia in the middle of a step."""

    model: mujoco.MjModel  # the scene, for the sparsity of its mass matrix
    names: tuple[str, ...]  # names of all geoms, as in contact labels
    limits: Limits  # the limits of joints and tendons
    rows: Rows  # the rows of the step
    kept: np.ndarray  # which groups are equality constraints that collisions must not violate, bool (g,)
    number: np.ndarray  # the equality constraint that each of these groups belongs to
    given: float  # how far these constraints are violated, m or rad
    geoms: np.ndarray  # geoms of MuJoCo's contacts, (ncon, 2)
    frame: np.ndarray  # frames of the contacts, normals first, (ncon, 9)
    position: np.ndarray  # contact points, m, (ncon, 3)
    limit_state: LimitState | None  # state of joints and tendons, if the rows include a limit
    inertia: Inertia  # the mass matrix of the step

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        rows: Rows,
        kept: np.ndarray,
        names: tuple[str, ...],
        limits: Limits,
        metric: Inertia,
    ) -> ContactSnapshot:
        """Return copies of the current contacts, rows and inertia."""
        contact = data.contact
        state = LimitState.of(data) if np.count_nonzero(rows.source < -1) else None
        equal = rows.row[rows.first[kept]]
        ties = data.efc_id[equal].copy(), float(np.abs(data.efc_pos[equal]).max(initial=0.0))
        copies = contact.geom.copy(), contact.frame.copy(), contact.pos.copy()
        inertia = metric._replace(factor=metric.factor.copy(), inverse=metric.inverse.copy())
        return cls(model, names, limits, rows, kept, *ties, *copies, state, inertia)

    def contacts(self, groups: np.ndarray) -> Contacts:
        """Return some groups as contacts; their indices, int (h,), begin with contacts and end with limits."""
        source = self.rows.source[groups]
        index = source[source >= 0]
        state, rows = self.limit_state, (-2 - source[source < -1]).tolist()
        codes = np.array([] if state is None else [self.limits.code(state, row) for row in rows], int)
        geoms, normal = self.geoms[index].astype(int), self.frame[index, :3]
        swapped = geoms[:, 0] > geoms[:, 1]
        geoms[swapped], normal[swapped] = geoms[swapped, ::-1], -normal[swapped]
        labels = contact_labels(geoms, self.names) + tuple(self.limits.labels[code] for code in codes)
        position = self.position[index]
        if state is not None:
            place, axis = self.limits.places(state, codes)
            position, normal = np.concatenate([position, place]), np.concatenate([normal, axis])
        geoms = np.concatenate([geoms, np.full((len(codes), 2), NO_GEOM)])
        return Contacts(labels, geoms, self.rows.gap[groups], position, normal)

    def tangential(self, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the friction rows of some groups, int (k,), and the index of the group of each row, int (k,)."""
        first, more = self.rows.first[groups], self.rows.size[groups] - 1
        contact = np.repeat(np.arange(len(groups)), more)
        return first[contact] + 1 + np.arange(len(contact)) - np.repeat(np.cumsum(more) - more, more), contact

    def collision(
        self, groups: np.ndarray, velocity: np.ndarray, labels: tuple[str, ...], *, friction: bool, acts: np.ndarray
    ) -> Collision:
        """Return the collision of some groups, int (h,), at v-, (nv,).

        It includes those of the `kept` equality constraints that act, bool (g,).
        """
        rows, friction_of_rows = self.rows, None
        first, (tangential, contact) = rows.first[groups], self.tangential(groups)
        J = self._gradients(first)
        if friction and len(contact):
            J_t = self._gradients(tangential)
            along = _beside(rows.before[tangential], J_t @ velocity)
            friction_of_rows = Friction(J_t, contact, rows.scale[tangential], along)
        surface = _beside(rows.before[first], J @ velocity)
        return Collision(
            self._root.T @ self._root,
            J,
            velocity,
            labels=labels,
            friction=friction_of_rows,
            surface_velocity=surface if surface.any() else None,
            bilateral_jacobian=self._constraints if acts is self.kept else self._constraints_of(acts[self.kept]),
        )

    @cached_property
    def _constraints(self) -> np.ndarray | None:
        """Gradients of the equality constraints to be respected, (k, nv)."""
        return self._constraints_of(np.ones(len(self.number), dtype=bool))

    def _constraints_of(self, acts: np.ndarray) -> np.ndarray | None:
        """Return `_constraints` for those equality constraints that act, bool (m,)."""
        first = self.rows.first[self.kept]
        if not len(first):
            return None
        return rows_that_count(self.model, self.number, self.given, self._gradients(first), self._whitened(first), acts)

    def reached(self, collides: np.ndarray, pushed: np.ndarray) -> np.ndarray:
        """Return which groups take part in a collision, bool (g,); see `targets.reached_groups`."""
        return for_python(reached_groups)(self.rows, self.model.dof_treeid, collides, pushed)

    def islands(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the islands of groups, int (g,), and of degrees of freedom, int (nv,); see `energy.islands_of`."""
        return islands_of(self.rows, self.model.dof_treeid)

    @cached_property
    def _root(self) -> np.ndarray:
        """``D^1/2 L``, (nv, nv), for which ``M_h = (D^1/2 L)^T D^1/2 L``."""
        factor, inverse, nnz, _, col = self.inertia
        root = np.zeros((len(inverse), len(inverse)))
        root[np.repeat(np.arange(len(inverse)), nnz), col] = factor
        np.fill_diagonal(root, 1.0)
        return root / np.sqrt(inverse)[:, None]

    def _whitened(self, which: np.ndarray) -> np.ndarray:
        """Return rows of Y, (k, nv)."""
        rows, Y = self.rows, np.zeros((len(which), len(self.inertia.inverse)))
        many, begin, _ = rows.sparse[:, which]
        for y, start, end in zip(Y, begin, begin + many, strict=True):
            y[rows.colind[start:end]] = rows.value[start:end]
        return Y

    def _gradients(self, which: np.ndarray) -> np.ndarray:
        """Return rows of ``J = Y D^1/2 L``, (k, nv), without rounding; rows of Y are scaled by friction."""
        J = (self._whitened(which) / self.rows.scale[which, None]) @ self._root
        J[np.abs(J) <= 1e-14 * np.abs(J).max(axis=1, keepdims=True, initial=0.0)] = 0.0
        return J


def _beside(velocity: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return the velocities of rows due to moving surfaces; rounding is set to 0."""
    drift = velocity - own
    drift[np.abs(drift) <= _ROUNDING * np.abs(velocity).max(initial=0.0)] = 0.0
    return drift
