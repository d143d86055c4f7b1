"""A collision: the mass matrix, the gap gradients of the closed contacts and the velocity before the impact."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlaw.errors import InvalidCollisionError
from impactlaw.metric import KineticMetric, finite_array
from impactlaw.solvers.base import row_lengths
from impactlaw.solvers.structure import MOST_DENSE
from impactlaw.sparse_metric import SparseMetric, finite_sparse, is_sparse

if TYPE_CHECKING:
    import mujoco

    from impactlaw.admissible import AdmissibleSet


@dataclass(frozen=True, eq=False)
class Collision:
    """Contacts closed at one configuration, met at one velocity.

    The gap velocities are ``gamma = J v``; ``gamma >= 0`` separates. Lengths on velocities are those of the
    kinetic metric, ``|v|^2 = v^T M v`` (Aeberhard and Glocker, "Perfect multi-contact collisions").

    Attributes:
        mass_matrix: ``M``, shape (nv, nv), symmetric positive definite. A scipy.sparse one may be diagonal or made of
            blocks, see `impactlaw.sparse_metric`.
        jacobian: ``J``, shape (h, nv); row i is the gradient of the gap of contact i. h may be 0. If it or M is sparse,
            both are kept as CSR arrays, and so are ``Y`` and ``G``.
        pre_velocity: ``v-``, shape (nv,).
        labels: one name per contact, for messages and for restitution keyed by contact; ``"0", "1", ...`` if not given.
        metric: the factored mass matrix, when the caller already has it.

    Raises:
        InvalidCollisionError: shapes do not fit, an entry is not finite, or M is not symmetric positive definite.
    """

    mass_matrix: np.ndarray
    jacobian: np.ndarray
    pre_velocity: np.ndarray
    labels: tuple[str, ...] = field(default=(), kw_only=True)
    metric: KineticMetric | SparseMetric = field(default=None, kw_only=True, repr=False)  # pyright: ignore[reportAssignmentType]

    def __post_init__(self):
        metric, jacobian = self.metric, self.jacobian
        if is_sparse(self.mass_matrix) or is_sparse(jacobian):
            metric = SparseMetric(self.mass_matrix) if metric is None else metric
            jacobian = finite_sparse(jacobian, "jacobian")
        else:
            metric = KineticMetric(self.mass_matrix) if metric is None else metric
            jacobian = finite_array(jacobian, "jacobian")
        nv = metric.mass_matrix.shape[0]
        velocity = finite_array(self.pre_velocity, "pre_velocity")
        if velocity.shape != (nv,):
            raise InvalidCollisionError(f"pre_velocity must have shape ({nv},) like mass_matrix, got {velocity.shape}")
        if jacobian.ndim != 2 or jacobian.shape[1] != nv:
            raise InvalidCollisionError(f"jacobian must have shape (h, {nv}) like mass_matrix, got {jacobian.shape}")
        h = jacobian.shape[0]
        labels = tuple(self.labels) or tuple(map(str, range(h)))
        if len(labels) != h:
            raise InvalidCollisionError(f"{len(labels)} labels for {h} contacts")
        self.__dict__.update(
            mass_matrix=metric.mass_matrix, metric=metric, jacobian=jacobian, pre_velocity=velocity, labels=labels
        )

    @classmethod
    def from_mujoco(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Collision:
        """Read the contacts that are closed now, and ``M`` and ``v-``, from a MuJoCo model and its state.

        Raises:
            SceneError: a contact that is not between two geoms (a flex).
        """
        from impactlaw.contacts import read_collision

        return read_collision(model, data)

    @cached_property
    def whitened_jacobian(self) -> np.ndarray:
        """``Y = J R^-T`` with ``M = R R^T``, shape (h, nv), so that ``G = Y Y^T``."""
        return self.metric.whiten_gradients(self.jacobian)

    @cached_property
    def dense_gradients(self) -> np.ndarray:
        """``Y`` as an array, shape (h, nv), for what has no sparse form.

        Raises:
            InvalidCollisionError: it is sparse and too large for that.
        """
        Y: Any = self.whitened_jacobian
        if not is_sparse(Y):
            return Y
        h, nv = Y.shape
        if h * nv > MOST_DENSE:
            raise InvalidCollisionError(
                f"{h} sparse gradients of length {nv} are too many for this; resolve, violations and contains can do it"
            )
        return Y.toarray()

    @cached_property
    def whitened_velocity(self) -> np.ndarray:
        """``R^T v-``, shape (nv,): v- where the kinetic metric is the Euclidean one."""
        return self.metric.whiten(self.pre_velocity)

    @cached_property
    def gradient_norms(self) -> np.ndarray:
        """``sqrt(G_ii)``, the length of each gap gradient in the kinetic metric, shape (h,), 1/sqrt(kg)."""
        return row_lengths(self.whitened_jacobian)

    @cached_property
    def delassus(self) -> np.ndarray:
        """``G = J M^-1 J^T``, shape (h, h)."""
        return self.whitened_jacobian @ self.whitened_jacobian.T

    @cached_property
    def pre_contact_velocity(self) -> np.ndarray:
        """``gamma- = J v-``, shape (h,), m/s."""
        return self.jacobian.dot(self.pre_velocity)

    @cached_property
    def pre_speed(self) -> float:
        """``|v-|`` in the kinetic metric, sqrt(J)."""
        return sqrt(self.whitened_velocity.dot(self.whitened_velocity))

    @cached_property
    def kinetic_energy(self) -> float:
        """``T- = |v-|^2 / 2``, J."""
        return 0.5 * self.pre_speed**2

    @cached_property
    def admissible_set(self) -> AdmissibleSet:
        """``S(v-)``, the set of possible right-velocities."""
        from impactlaw.admissible import AdmissibleSet

        return AdmissibleSet(self)
