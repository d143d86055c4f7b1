"""A collision: the mass matrix, the gap gradients of the closed contacts and the velocity before the impact."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError, SolverError
from impactlaw.mechanics.arrays import finite_array, finite_sparse, is_sparse, of_shape
from impactlaw.mechanics.bilateral import Bilateral, Reached, eliminated, velocity_with
from impactlaw.mechanics.block_metric import SparseMetric
from impactlaw.mechanics.friction import ConeRows, Friction
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.mechanics.tolerances import FIXED, IDLE, SHORTENED
from impactlaw.solvers.problem import row_lengths
from impactlaw.solvers.sparsity import MOST_DENSE

if TYPE_CHECKING:
    import mujoco

    from impactlaw.mechanics.admissible.admissible_set import AdmissibleSet


@dataclass(frozen=True, eq=False)
class Collision:
    """A set of contacts that are closed at one configuration, and the velocity before their impact.

    The contact velocities are ``gamma = J v + w``, where w is the contribution of moving surfaces; ``gamma >= 0``
    separates. Velocities are measured in the kinetic metric, ``|v|^2 = v^T M v`` (Aeberhard and Glocker, "Perfect
    multi-contact collisions"). Bilateral constraints keep their velocity, ``J_eq v+ = J_eq v-``, by their own impulses.

    Attributes:
        mass_matrix: ``M``, shape (nv, nv), symmetric positive definite. A scipy.sparse matrix may be diagonal or
            consist of blocks, see `impactlaw.mechanics.block_metric`.
        jacobian: ``J``, shape (h, nv); row i is the gradient of the gap function of contact i. h may be 0. If J or M is
            sparse, both are kept as CSR arrays, and so are `whitened_jacobian` and `delassus`.
        pre_velocity: ``v-``, shape (nv,).
        labels: one name per contact, for messages and for restitution keyed by contact; ``"0", "1", ...`` by default.
        metric: the factored mass matrix, if the caller already has it; used if its mass_matrix is this very array.
        bilateral_jacobian: ``J_eq``, shape (m, nv), redundant rows allowed; None if there are no such constraints.
        surface_velocity: ``w-``, shape (h,), m/s: the part of ``gamma-`` that does not come from v-, positive where a
            surface recedes; None if all surfaces are at rest.
        post_surface_velocity: ``w+``, shape (h,); None if it equals w-. A surface whose velocity jumps, as under the
            blow of a hammer, causes a collision by itself.
        friction: rows of friction of these contacts, for `impactlaw.Coulomb`; other laws ignore it.

    Raises:
        InvalidCollisionError: shapes do not fit, an entry is not finite, M is not symmetric positive definite, labels
            are not strings, or bilateral constraints, moving surfaces or friction are combined with sparse arrays.
    """

    mass_matrix: np.ndarray
    jacobian: np.ndarray
    pre_velocity: np.ndarray
    labels: tuple[str, ...] = field(default=(), kw_only=True)
    metric: KineticMetric = field(default=None, kw_only=True, repr=False)  # pyright: ignore[reportAssignmentType]
    bilateral_jacobian: np.ndarray | None = field(default=None, kw_only=True)
    surface_velocity: np.ndarray | None = field(default=None, kw_only=True)
    post_surface_velocity: np.ndarray | None = field(default=None, kw_only=True)
    friction: Friction | None = field(default=None, kw_only=True)

    def __post_init__(self):
        sparse = is_sparse(self.mass_matrix) or is_sparse(self.jacobian)
        known = self.metric is not None and self.metric.mass_matrix is self.mass_matrix
        metric = self.metric if known else (SparseMetric if sparse else KineticMetric)(self.mass_matrix)
        nv = metric.mass_matrix.shape[0]
        velocity = finite_array(self.pre_velocity, "pre_velocity", (nv,), " like mass_matrix")
        jacobian = (finite_sparse if sparse else finite_array)(self.jacobian, "jacobian")
        h = of_shape(jacobian, "jacobian", ("h", nv), " like mass_matrix").shape[0]
        labels = (tuple(self.labels) or tuple(map(str, range(h)))) if np.iterable(self.labels) else (self.labels,)
        if isinstance(self.labels, str) or not all(issubclass(kind, str) for kind in set(map(type, labels))):
            raise InvalidCollisionError(f"labels are texts, one for each contact, got {self.labels!r:.100}")
        if len(labels) != h:
            raise InvalidCollisionError(f"{len(labels)} labels for {h} contacts")
        put, given = object.__setattr__, {"jacobian": jacobian, "pre_velocity": velocity, "labels": labels}
        for name, value in {"mass_matrix": metric.mass_matrix, "metric": metric, **given}.items():
            put(self, name, value)
        if self.friction is not None:
            if not isinstance(self.friction, Friction):
                raise InvalidCollisionError(f"friction of a collision is a Friction, got {self.friction!r:.100}")
            self.friction.check(h, nv)
        if self.bilateral_jacobian is not None:
            rows = finite_array(self.bilateral_jacobian, "bilateral_jacobian", ("m", nv))
            put(self, "bilateral_jacobian", rows if rows.any() else None)
        if self.surface_velocity is not None or self.post_surface_velocity is not None:
            before = np.zeros(h) if self.surface_velocity is None else self.surface_velocity
            after = before if self.post_surface_velocity is None else self.post_surface_velocity
            before = finite_array(before, "surface_velocity", (h,), ", one entry per contact")
            after = finite_array(after, "post_surface_velocity", (h,), ", one entry per contact")
            put(self, "surface_velocity", before if before.any() or after.any() else None)
            put(self, "post_surface_velocity", None if np.array_equal(before, after) else after)
        dense = self.friction, self.bilateral_jacobian, self.surface_velocity
        if sparse and any(part is not None for part in dense):
            raise InvalidCollisionError("friction, constraints and moving surfaces need dense mass_matrix and jacobian")

    @classmethod
    def from_mujoco(cls, model: mujoco.MjModel, data: mujoco.MjData, *, friction: bool = False) -> Collision:
        """Read the contacts that are closed now, with ``M`` and ``v-``, from a MuJoCo model and its state.

        Active equality constraints become bilateral constraints. Moving surfaces are not read, only `impactlaw.Stepper`
        knows their velocities.

        Args:
            model: the compiled scene; not changed.
            data: its state; qpos, qvel, mocap poses and the active flags of equality constraints are read; not changed.
            friction: whether to also read the friction of these contacts, for `impactlaw.Coulomb` and
                `FrictionImpact.observed`. Without friction the collision has an admissible set.

        Raises:
            SceneError: a contact is not between two geoms (a flex); or data belongs to another model.
            InvalidCollisionError: the state is not finite, or the model has no degrees of freedom.
            OptionError: friction is not True or False.
        """
        from impactlaw.scene.read import read_closed

        M, near, rows = read_closed(model, data, friction=friction)
        labels, rubbed = near.contacts.labels, None if rows is None else Friction(*rows)
        return cls(M, near.jacobian, data.qvel, labels=labels, bilateral_jacobian=near.bilateral, friction=rubbed)

    @cached_property
    def whitened_jacobian(self) -> np.ndarray:
        """``Y = J R^-T P`` with ``M = R R^T``, shape (h, nv), so that ``G = Y Y^T``.

        P projects out the directions that bilateral constraints fix (`impactlaw.mechanics.bilateral`); without
        constraints it is the identity.
        """
        return self._whitened(self.jacobian)

    @cached_property
    def whitened_friction(self) -> np.ndarray:
        """``J_t R^-T P``, shape (k, nv), for the rows of friction, without their coefficients."""
        rows = np.zeros((0, len(self.pre_velocity))) if self.friction is None else self.friction.jacobian
        return self._whitened(rows)

    @cached_property
    def cone_rows(self) -> ConeRows:
        """The order in which normal rows and rows of friction form the cone problem."""
        h, contact = len(self.labels), np.zeros(0, dtype=int) if self.friction is None else self.friction.contact
        order = np.argsort(np.concatenate([np.arange(h), contact]), kind="stable")
        return ConeRows(order, 1 + np.bincount(contact, minlength=h))

    @cached_property
    def without_idle_friction(self) -> Collision:
        """The collision without the friction of contacts that no normal impulse can move; their gap gradients become 0.

        An example is a contact whose normal meets the axis of a hinge. Its normal impulse would be arbitrary, and with
        it its friction. Gap gradients stay as they are beside bilateral constraints, which may close such a contact.

        Raises:
            SolverError: a gap gradient is rounding next to the rows of friction only because coefficients are huge.
        """
        friction = self.friction
        if friction is None or not len(friction):
            return self
        longest, along = np.zeros((2, len(self.labels))), row_lengths(self.whitened_friction)
        np.maximum.at(longest[0], friction.contact, along * friction.coefficient)
        np.maximum.at(longest[1], friction.contact, along * np.minimum(friction.coefficient, 1.0))
        idle, unmoved = self.gradient_norms <= IDLE * longest
        if (idle & ~unmoved).any():
            named = ", ".join(compress(self.labels, idle & ~unmoved))
            raise SolverError(f"coefficients of friction of contacts {named} are too large to be resolved; 100 will do")
        rows, acts = idle[friction.contact], ~idle[:, None] | (self.bilateral_jacobian is not None)
        return replace(self, jacobian=self.jacobian * acts, friction=friction.without(rows)) if rows.any() else self

    def _whitened(self, rows: np.ndarray) -> np.ndarray:
        Y, constraints = self.metric.whiten_gradients(rows), self.bilateral_jacobian
        if constraints is None:
            return Y
        left = self._bilateral.project(Y)
        short = left.any(axis=1) & (np.vecdot(left, left) <= SHORTENED**2 * np.vecdot(Y, Y))
        if short.any():
            J = eliminated(rows[short], constraints, len(self._bilateral.basis), self.mass_matrix.diagonal())
            left[short] = self._bilateral.project(self.metric.whiten_gradients(J))
        return left

    @cached_property
    def _bilateral(self) -> Bilateral:
        assert self.bilateral_jacobian is not None
        return Bilateral.of(self.metric.whiten_gradients(self.bilateral_jacobian))

    @cached_property
    def dense_gradients(self) -> np.ndarray:
        """``Y`` as a dense array, (h, nv), for methods without a sparse form; `InvalidCollisionError` if too large."""
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
        """``R^T v-``, shape (nv,): v- in coordinates in which the kinetic metric is the Euclidean one."""
        return self.metric.whiten(self.pre_velocity)

    @cached_property
    def gradient_norms(self) -> np.ndarray:
        """``sqrt(G_ii)``, the length of each gap gradient in the kinetic metric, shape (h,), 1/sqrt(kg)."""
        return row_lengths(self.whitened_jacobian)

    @cached_property
    def delassus(self) -> np.ndarray:
        """``G = Y Y^T``, shape (h, h): ``J M^-1 J^T`` where there are no bilateral constraints."""
        Y = self.whitened_jacobian
        return Y @ Y.T

    @cached_property
    def pre_contact_velocity(self) -> np.ndarray:
        """``gamma- = J v- + w-``, shape (h,), m/s; read-only, so that a law cannot spoil the checks of its outcome."""
        gamma = self._own_velocity(self.pre_velocity)
        return _kept(gamma if self.surface_velocity is None else gamma + self.surface_velocity)

    def _own_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``J v``, (h,), with 0 instead of the rounding error at contacts that constraints keep from moving."""
        gamma = self.jacobian.dot(velocity)
        if self.bilateral_jacobian is not None and not self.gradient_norms.all():
            lengths = row_lengths(self.metric.whiten_gradients(self.jacobian))
            gamma[(self.gradient_norms == 0) & (np.abs(gamma) <= FIXED * lengths * self.metric.norm(velocity))] = 0.0
        return gamma

    @cached_property
    def pre_sliding_velocity(self) -> np.ndarray:
        """``gamma_t- = J_t v- + w_t-``, shape (k,), m/s or rad/s, for the rows of friction; read-only."""
        if self.friction is None:
            return np.zeros(0)
        return _kept(self.friction.jacobian @ self.pre_velocity + self.friction.surface_velocity)

    def part(self, contacts: np.ndarray) -> Collision:
        """Return the collision of some contacts alone, with their friction; the indices, int (k,), are ascending."""
        before, after, friction = self.surface_velocity, self.post_surface_velocity, self.friction
        if friction is not None:
            none = Friction(np.zeros((0, len(self.pre_velocity))), np.zeros(0, dtype=int), np.zeros(0))
            friction = friction.select(contacts) or none
        return replace(
            self,
            jacobian=self.jacobian[contacts],
            labels=tuple(self.labels[i] for i in contacts),
            surface_velocity=None if before is None else before[contacts],
            post_surface_velocity=None if after is None else after[contacts],
            friction=friction,
        )

    def velocity(self, values: ArrayLike, name: str) -> np.ndarray:
        """Return a read-only copy of a velocity of the bodies, (nv,); `InvalidCollisionError` if it is not valid."""
        return finite_array(values, name, self.pre_velocity.shape, " like pre_velocity")

    def contact_velocity_after(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``J v + w+``, shape (h,), m/s, for a velocity after the impact, shape (nv,)."""
        gamma = self._own_velocity(velocity)
        if self.surface_velocity is None:
            return gamma
        return gamma + (self.surface_velocity if self.post_surface_velocity is None else self.post_surface_velocity)

    @property
    def surface_jump(self) -> np.ndarray | None:
        """``w+ - w-``, shape (h,), m/s; None if it is 0."""
        if self.post_surface_velocity is None or self.surface_velocity is None:
            return None
        return self.post_surface_velocity - self.surface_velocity

    @property
    def after_surface_jump(self) -> Collision:
        """The collision whose surfaces have their velocities after the impact, w+ and w_t+, from the start."""
        c, friction = self, self.friction
        if friction is not None and friction.surface_jump.any():
            c = replace(c, friction=replace(friction, surface_velocity=friction.post_surface_velocity))
        if c.surface_jump is not None:
            c = replace(c, surface_velocity=c.post_surface_velocity, post_surface_velocity=None)
        return c

    @cached_property
    def frame_rates(self) -> np.ndarray | None:
        """The part of ``gamma-bar`` that impulses cannot change, shape (h,), m/s; None if it is 0.

        It is ``(w- + w+) / 2``, plus the motion along bilateral constraints if these move, ``J_eq v- != 0``.
        """
        rates, jump = self.surface_velocity, self.surface_jump
        if rates is not None and jump is not None:
            rates = rates + 0.5 * jump
        if self.bilateral_jacobian is not None and self._fixed is not None:
            moving = self.metric.whiten_gradients(self.jacobian) @ self._fixed
            rates = moving if rates is None else rates + moving
        return rates

    @cached_property
    def _fixed(self) -> np.ndarray | None:
        """The part of ``R^T v-`` that bilateral constraints keep, shape (nv,); None if they are at rest."""
        return None if self.bilateral_jacobian is None else self._bilateral.along(self.whitened_velocity)

    @cached_property
    def _frame(self) -> Reached:
        assert self.frame_rates is not None
        return velocity_with(self.whitened_jacobian, self.frame_rates)

    @property
    def has_frame(self) -> bool:
        """Whether one velocity of the bodies moves with all surfaces, and surface velocities do not jump."""
        return self.frame_rates is None or (self.surface_jump is None and self._frame.is_exact)

    @property
    def has_admissible_set(self) -> bool:
        """Whether S(v-) is defined for this collision: it has no friction, and moving surfaces move together."""
        return self.friction is None and self.has_frame

    @property
    def relative_velocity(self) -> np.ndarray:
        """``P R^T v-`` relative to the moving surfaces, shape (nv,): plus the c with ``Y c`` equal to `frame_rates`.

        Where surfaces move against each other, c is the least-squares solution.
        """
        z = self.whitened_velocity
        if self.frame_rates is None:
            return z
        return (z if self._fixed is None else z - self._fixed) + self._frame.velocity

    @cached_property
    def pre_speed(self) -> float:
        """``|v-|`` in the kinetic metric, sqrt(J); relative to moving surfaces if that is larger."""
        z, relative = self.whitened_velocity, self.relative_velocity
        return sqrt(z.dot(z)) if relative is z else sqrt(max(z.dot(z), relative.dot(relative)))

    @cached_property
    def kinetic_energy(self) -> float:
        """``T- = |v-|^2 / 2``, J."""
        z = self.whitened_velocity
        return 0.5 * float(z @ z)

    @cached_property
    def admissible_set(self) -> AdmissibleSet:
        """``S(v-)``, the set of possible right-velocities."""
        from impactlaw.mechanics.admissible.admissible_set import AdmissibleSet

        return AdmissibleSet(self)


def _kept(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values


def checked(collision: object) -> Collision:
    """Return the argument; raise `InvalidCollisionError` if it is not a `Collision`."""
    if not isinstance(collision, Collision):
        raise InvalidCollisionError(
            f"this takes a Collision, got {collision!r:.100}; Collision(mass, jacobian, velocity) and "
            "Collision.from_mujoco(model, data) make one"
        )
    return collision
