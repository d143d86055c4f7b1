"""The base class of impact laws: a law gives target contact velocities, and complementarity gives the impulse."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import MISSING, dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError, RestitutionError
from impactlaw.mechanics.arrays import finite_array, finite_sparse, is_sparse
from impactlaw.mechanics.bilateral import velocity_with
from impactlaw.mechanics.collision import Collision, checked
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers import Problem, solve_with_jump
from impactlaw.solvers.tolerances import RANK


class Target(NamedTuple):
    """The contact velocities that a law aims at.

    Attributes:
        contact_velocity: ``gamma^h``, shape (h,), m/s.
        velocity: a velocity u with ``J u = gamma^h``, shape (nv,), if the law knows one.
        coefficient: e, if ``u = -e v-`` is such a velocity; ``velocity`` may then be left out.
    """

    contact_velocity: np.ndarray
    velocity: np.ndarray | None = None
    coefficient: float | None = None


@dataclass(frozen=True, eq=False)
class Law(ABC):
    """An impact law ``0 <= Lambda  ⊥  gamma+ - gamma^h >= 0``, ``v+ = v- + M^-1 J^T Lambda``.

    A law is a frozen dataclass with one method, `target`, which gives ``gamma^h``
    (Aeberhard and Glocker, "Perfect multi-contact collisions", extended Newton impact law). For `make_law` to find it,
    it needs a name, a description and one line in `impactlaw.laws.registry`.

    A law applies to contacts that close or are at rest, ``gamma- <= 0``. For a contact that already opens, a law that
    reverses velocities would aim at penetration; steppers leave such contacts out.

    Attributes:
        name: the name of the law in `make_law`.
        description: one line for lists of laws.
        has_friction: whether the law also decides about friction.
        per_contact: whether the target of each contact depends on the velocity of that contact only.
        takes_restitution: whether `make_law` takes a restitution together with the name of the law.
    """

    name = ""
    description = ""
    has_friction = False
    per_contact = False
    takes_restitution = True

    @classmethod
    def of(cls, restitution: Any) -> Law:
        """Return the law with the restitution given to `make_law`; None means the law's own default, if it has one.

        Raises:
            RestitutionError: the restitution is missing, superfluous or not in range.
        """
        if restitution is not None and not cls.takes_restitution:
            raise RestitutionError(f"law {cls.name!r} takes no restitution, got {restitution!r}; leave it out")
        if restitution is None and any(part.default is MISSING and not part.kw_only for part in fields(cls)):
            raise RestitutionError(f"law {cls.name!r} needs a restitution")
        return cls() if restitution is None else cls(restitution)  # pyright: ignore[reportCallIssue]

    @property
    def has_target(self) -> bool:
        """Whether the target alone decides the outcome: False for a law with its own `resolve`, such as Poisson's."""
        return type(self).resolve is Law.resolve

    @property
    def normal_law(self) -> Law:
        """The law that decides along the normals: this law itself, or the one to which it adds friction."""
        return self

    @property
    def common_coefficient(self) -> float | None:
        """The number e if ``gamma^h = -e gamma-`` for every contact of any collision, else None."""
        return None

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels and patterns by which the normal law is keyed, in canonical form; empty if it has no keys."""
        return frozenset() if self.normal_law is self else self.normal_law.contact_labels

    @property
    def contact_count(self) -> int | None:
        """Number of contacts that the normal law fits; None if it fits any number."""
        return None if self.normal_law is self else self.normal_law.contact_count

    def seeded(self, seed: int) -> Law:
        """Return the law with this seed, 0 or more, if it draws its outcomes and has no seed of its own."""
        return self

    @abstractmethod
    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h`` for this collision.

        Raises:
            RestitutionError: the law's coefficients do not fit the contacts.
        """

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the outcome of the collision under this law.

        Args:
            collision: the collision to resolve.
            solver: a name from `impactlaw.solvers.SOLVERS`, or "auto".

        Raises:
            InvalidCollisionError: the argument is not a `Collision`.
            RestitutionError: the law's coefficients do not fit the number of contacts.
            UnknownNameError: no such solver.
            UnsolvableLawError: no velocity satisfies the law; the message names the contacts that conflict.
            SolverError: no solver's answer passed its certificate.
        """
        target = aim(self, checked(collision))
        problem = jump_problem(collision, target)
        answer = solve_with_jump(problem, collision.labels, solver=solver, shared=False)
        return Impact.solved(collision, problem, answer, target.contact_velocity)


def aim(law: Law, collision: Collision) -> Target:
    """Return the law's target after checking it, with its contact velocity as an array of h finite numbers.

    Laws may be written by users; `RestitutionError` says what is wrong with their target.
    """
    target, h = law.target(collision), len(collision.labels)
    if not isinstance(target, Target):
        what = f"must return a Target, as Target(contact_velocity), not {type(target).__name__}"
        raise RestitutionError(f"target() of {law!r} {what}")
    wanted = np.asarray(target.contact_velocity, dtype=float)
    if wanted.shape != (h,):
        raise RestitutionError(f"target() of {law!r} has shape {wanted.shape}, but {h} contacts collide: ({h},)")
    if not math.isfinite(wanted.dot(wanted)) and not np.isfinite(wanted).all():
        raise RestitutionError(f"target() of {law!r} is not finite: {wanted}")
    return target if wanted is target.contact_velocity else target._replace(contact_velocity=wanted)


def jump_problem(collision: Collision, target: Target) -> Problem:
    """Return the problem whose solution is the velocity jump of the law, the smallest one that reaches the target."""
    wanted, velocity, e = target
    Y, preimage = collision.whitened_jacobian, None
    bound = wanted - collision.pre_contact_velocity
    if collision.frame_rates is not None or collision.bilateral_jacobian is not None:
        if collision.surface_jump is not None:
            bound = bound - collision.surface_jump
        found = velocity_with(Y, bound)
        preimage = found.velocity if found.is_exact else None
    elif e is not None:
        preimage = (-1.0 - e) * collision.whitened_velocity
    elif velocity is not None:
        preimage = collision.metric.whiten(velocity - collision.pre_velocity)
    return Problem(Y, bound, preimage, collision.pre_speed, norms=collision.gradient_norms)


class RestitutionLaw(Law):
    """A law with a restitution matrix, ``gamma^h = -E gamma-``; ``E = e 1`` if it has a `common_coefficient` e."""

    def restitution_matrix(self, collision: Collision) -> Any:
        """Return ``E`` for the contacts of this collision, shape (h, h), as a dense or a CSR array."""
        assert self.common_coefficient is not None
        return self.common_coefficient * np.eye(len(collision.labels))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = -E gamma-``; for ``E = e 1`` also the coefficient e."""
        e, gamma = self.common_coefficient, collision.pre_contact_velocity
        return Target(-(self.restitution_matrix(collision) @ gamma)) if e is None else Target(-e * gamma, coefficient=e)


def energy_gain(collision: Collision, restitution_matrix: ArrayLike) -> float:
    """Return the largest factor by which ``E`` can change the energy of the contacts' motion, over all ``gamma-``.

    With all contacts active, E, of shape (h, h), is dissipative for every ``gamma-`` iff ``E^T G^-1 E <= G^-1``, that
    is iff this number, the largest eigenvalue of ``G E^T G^-1 E``, is at most 1; for an isometry (elastic law) it is 1.
    With redundant contacts only ``gamma-`` in the range of J count.

    Raises:
        RestitutionError: E has the wrong shape or entries that are not finite.
        InvalidCollisionError: the argument is not a `Collision`, or is sparse and too large.
    """
    E, collision = square_matrix(restitution_matrix), checked(collision)
    if len(E) != len(collision.labels):
        raise RestitutionError(f"restitution matrix is {E.shape} for {len(collision.labels)} contacts")
    if not collision.gradient_norms.any():
        return 0.0
    lengths = np.where(collision.gradient_norms > 0, collision.gradient_norms, 1.0)
    U, s, _ = np.linalg.svd(collision.dense_gradients / lengths[:, None], full_matrices=False)
    U, s = U[:, s > RANK * s[0]], s[s > RANK * s[0]]
    scaled = E * (lengths / lengths[:, None])
    return float(np.linalg.norm(U.T @ scaled @ (U * s) / s[:, None], 2) ** 2)


def number(value: Any) -> float | None:
    """Return ``value`` as a float; None for strings, truth values, complex numbers and values that are not numbers."""
    if isinstance(value, str | bytes | bool | np.bool_) or np.iscomplexobj(value):
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def coefficient(value: object, name: str = "restitution") -> float:
    """Return ``value`` as a number in [0, 1]; raise `RestitutionError` if it is not one."""
    e = number(value)
    if e is None:
        raise RestitutionError(f"{name} must be a number in [0, 1], got {value!r}")
    if not 0.0 <= e <= 1.0:
        raise RestitutionError(f"{name} must lie in [0, 1], got {e}")
    return e


def is_semidefinite(matrix: np.ndarray, rounding: float) -> bool:
    """Return whether a matrix is symmetric and positive semidefinite, up to ``rounding`` times its largest entry."""
    allowed = rounding * np.abs(matrix).max(initial=0.0)
    symmetric = (np.abs(matrix - matrix.T) <= allowed).all()
    return bool(symmetric) and np.linalg.eigvalsh(matrix).min(initial=0.0) >= -allowed


def square_matrix(value: Any, name: str = "restitution matrix", *, sparse: bool = False) -> Any:
    """Return ``value`` as a read-only, finite, square array; a sparse one, if allowed, as a CSR array."""
    try:
        matrix = finite_sparse(value, name) if sparse and is_sparse(value) else finite_array(value, name)
    except InvalidCollisionError as error:
        raise RestitutionError(f"{error}; it must be a square array of numbers") from None
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise RestitutionError(f"{name} must be square, got shape {matrix.shape}")
    return matrix
