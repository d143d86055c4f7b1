"""The set of possible right-velocities: the outcomes without pulling, penetration and energy gain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError, SolverError
from impactlaw.mechanics.admissible.capped_polyhedron import CappedPolyhedron
from impactlaw.mechanics.admissible.cone import cone_facets
from impactlaw.mechanics.admissible.sampling import check_number, generator_of, uniform_samples
from impactlaw.mechanics.admissible.violations import measured, pushed
from impactlaw.mechanics.tolerances import POINT, SET_CERTIFIED, SET_RANK, TIGHT
from impactlaw.solvers import nonnegative_combination
from impactlaw.solvers.least_squares import row_span


@dataclass(frozen=True, eq=False)
class AdmissibleSet:
    """``S(v-) = {v : J v >= 0, v = v- + M^-1 J^T Lambda, Lambda >= 0, |v| <= |v-|}``, lengths in the kinetic metric.

    No penetration, no pulling, no energy gain (Aeberhard and Glocker, "Perfect multi-contact collisions"). S is convex
    and never empty: it contains p, the point of maximal dissipation, which has the least energy. It is ``{v-}`` if no
    contact closes, ``gamma- >= 0``.

    `contains` works for any collision. The other methods need the facets of the cone of the gradients, and raise
    `EnumerationError` if contacts are so redundant that there are too many facets (`cone.MAX_FACETS`); 16 contacts of
    rank 12 are still possible. An invalid velocity, direction or tolerance raises `InvalidCollisionError`.

    The relative error of results, compared with ``|v-|``, is rounding times the condition number of the gradients of
    unit length. If no digits are left, `SolverError` is raised.

    If surfaces move together, S is defined relative to them: ``J v + w >= 0``, and no energy gain beyond their work.

    Attributes:
        collision: the `Collision`, with ``M``, ``J`` and ``v-``.

    Raises:
        InvalidCollisionError: the argument is not a `Collision`; contacts have friction; or surfaces move against each
            other or their velocity jumps, so that the ball of S has no center.
    """

    collision: Any

    def __post_init__(self):
        if not hasattr(type(self.collision), "admissible_set"):  # the module of `Collision` imports this one
            raise InvalidCollisionError(f"S(v-) is that of a Collision, got {self.collision!r:.100}")
        if self.collision.friction is not None:
            raise InvalidCollisionError("S(v-) is without friction; FrictionImpact.violations covers contacts with it")
        if not self.collision.has_frame:
            raise InvalidCollisionError(
                "surfaces move against each other, or their velocity jumps: S(v-) is for surfaces that move together; "
                "Impact.violations covers the others"
            )

    def contains(self, v: ArrayLike, tol: float = 1e-9) -> bool:
        """Whether v is in S: its distances to the three sets that S is made of are at most ``tol |v-|``."""
        c, v = self.collision, self.collision.velocity(v, "v")
        jump = c.metric.whiten(v - c.pre_velocity)
        impulse = nonnegative_combination(c.whitened_jacobian, jump)
        violations = measured(c, jump, c.contact_velocity_after(v), *pushed(c, jump, impulse), c.pre_speed)
        return violations.is_admissible(tol)

    def distance(self, v: ArrayLike) -> float:
        """Return ``min |v - s|`` over s in S, sqrt(J); 0 (up to rounding of v-) for members."""
        return self.collision.metric.norm(self.collision.velocity(v, "v") - self.project(v))

    def project(self, v: ArrayLike) -> np.ndarray:
        """Return the point of S nearest to v in the kinetic metric, shape (nv,); for a member of S that is v."""
        c, v = self.collision, self.collision.velocity(v, "v")
        if self._body is None:
            return c.pre_velocity.copy()
        x = self._basis @ c.metric.whiten(v - c.pre_velocity) / self._least
        return self._velocity_at(self._least * self._body.nearest(x))

    def support(self, direction: ArrayLike) -> float:
        """Return ``max <u, v>`` over v in S, with ``<u, v> = u^T M v``, for a direction u, (nv,), of any length."""
        c = self.collision
        u = c.metric.whiten(c.velocity(direction, "direction"))
        start = float(u @ c.whitened_velocity)
        along = self._basis @ u
        length = float(np.linalg.norm(along))
        if self._body is None or length == 0.0:
            return start
        jump = self._least * self._body.extreme(along / length)
        self._velocity_at(jump)  # checks the certificate
        return start + float(along @ jump)

    def sample(self, n: int, rng: np.random.Generator | int) -> np.ndarray:
        """Return n independent velocities, uniform in S, shape (n, nv), from a generator or a seed for one.

        Uniform refers to the volume of the kinetic metric on the affine hull of S, whose dimension is between 0, a
        point, and the rank of J.

        Raises:
            InvalidCollisionError: n is not a whole number or negative, or rng is neither a generator nor a seed.
        """
        check_number(n)
        generator = generator_of(rng)
        if self._body is None:
            return np.tile(self.collision.pre_velocity, (n, 1))
        return self._velocity_at(self._least * uniform_samples(self._body, n, generator))

    def intensity_range(self) -> tuple[float, float]:
        """Return the least and the largest ``rho = |v - v-|`` over v in S, sqrt(J).

        The least is ``|p - v-|``, where p is the point of maximal dissipation. The largest is at most twice that, since
        energy does not grow; only Moreau's elastic outcome ``2 p - v-`` reaches it, which is in S if ``gamma- <= 0``.
        If it is not in S, the largest is found by a search through the faces of S, with `EnumerationError` if there are
        too many.
        """
        if self._body is None:
            return 0.0, 0.0
        elastic = 2.0 * self._body.inside
        if self._body.has(elastic, TIGHT):
            return self._least, 2.0 * self._least
        return self._least, self._least * float(np.linalg.norm(self._body.farthest()))

    @cached_property
    def _least_jump(self) -> np.ndarray:
        """``R^T (p - v-)`` in the basis, shape (r,): minus the part of v- in the span of the contacts with impulse."""
        z = self._basis @ self.collision.relative_velocity
        Y = self._unit_gradients @ self._basis.T
        span = scipy.linalg.orth(Y[nonnegative_combination(Y, -z, shared=False) > 0].T, rcond=SET_RANK)
        return -span @ (span.T @ z)

    @cached_property
    def _least(self) -> float:
        """``|p - v-|``: S lies between once and twice this distance from v-."""
        return float(np.linalg.norm(self._least_jump))

    @cached_property
    def _unit_gradients(self) -> np.ndarray:
        """The nonzero gradients, scaled to unit length in the kinetic metric."""
        c = self.collision
        moving = c.gradient_norms > 0
        return c.dense_gradients[moving] / c.gradient_norms[moving, None]

    @cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal rows that span the gradients, shape (r, nv)."""
        return row_span(self._unit_gradients, SET_RANK)[0]

    @cached_property
    def _body(self) -> CappedPolyhedron | None:
        """S in coordinates ``x = R^T (v - v-) / |p - v-|`` of the span of the gradients; None if S is the point v-.

        In x, ``J v >= 0`` becomes ``Y x >= -gamma- / |p - v-|``, and ``|v| <= |v-|`` a ball around
        ``-R^T v- / |p - v-|`` whose sphere passes through 0. A contact with ``gamma- > 2 |p - v-|``, in units of the
        length of its gradient, stays open anyway and is left out.
        """
        c = self.collision
        self._velocity_at(self._least_jump)  # checks the certificate
        if self._least <= POINT * c.pre_speed:
            return None
        moving = c.gradient_norms > 0
        b = -c.pre_contact_velocity[moving] / (c.gradient_norms[moving] * self._least)
        Y = self._unit_gradients @ self._basis.T
        F = cone_facets(Y)
        near = b >= -2.0 - TIGHT
        return CappedPolyhedron(
            np.vstack([Y[near], F]),
            np.concatenate([b[near], np.zeros(len(F))]),
            -(self._basis @ c.relative_velocity) / self._least,
            self._least_jump / self._least,
        )

    def _velocity_at(self, jump: np.ndarray) -> np.ndarray:
        """Return the velocity, or n velocities, for jumps in the basis, (r,) or (n, r); certify the first eight."""
        c = self.collision
        v = c.pre_velocity + c.metric.unwhiten(jump @ self._basis)
        if not all(self.contains(one, SET_CERTIFIED) for one in np.atleast_2d(v)[:8]):
            raise SolverError(
                f"S is lost to rounding: gradients of these {len(c.labels)} contacts depend on each other all but "
                "exactly; leave redundant contacts out"
            )
        return v
