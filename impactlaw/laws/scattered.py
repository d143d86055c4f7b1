"""A law with scatter: outcomes around those of another law, in the set of possible right-velocities."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, Target, square_matrix
from impactlaw.laws.drawn.drawing import checked_seed, generator
from impactlaw.mechanics.admissible.sampling import check_number
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, eq=False)
class Scattered(Law):
    """``v+ = prox_S(v_law + |v-| delta)``: the law's outcome, moved at random and projected onto S(v-).

    The contact velocities of ``delta`` are ``G^1/2 xi`` with xi normal of mean 0 and the given covariance, so that
    ``|delta| = |xi|`` in the kinetic metric: the covariance of relative errors, as `identification.fit` reports them.

    The sample is drawn from the seed and the collision's own numbers: the same collision has the same outcome, in every
    process, and a run can be repeated. `sample` draws many. (`AnyOutcome` draws from all of S, around no law.) Where
    there is no S(v-), as between surfaces that move against each other or whose velocity jumps, nothing is scattered.

    Attributes:
        law: the law in the middle.
        covariance: of xi: a variance that all contacts have, or a matrix, shape (h, h).
        seed: of the samples, 0 or more. None is 0, but environments then draw another one for each episode.

    Raises:
        RestitutionError: not a law without friction, not a covariance, or not a seed.
    """

    law: Law
    covariance: ArrayLike
    seed: int | None = field(default=None, kw_only=True)

    def __post_init__(self):
        if not isinstance(self.law, Law) or self.law.has_friction:
            raise RestitutionError(
                f"Scattered takes a law without friction, got {self.law!r}; friction goes around it: "
                "Coulomb(Scattered(law, covariance))"
            )
        if np.ndim(self.covariance) == 0:
            try:
                value = float(np.asarray(self.covariance))
            except (TypeError, ValueError):
                value = np.nan
            if not 0.0 <= value < np.inf:
                raise RestitutionError(f"a variance must be 0 or more, and finite, got {self.covariance!r}")
            object.__setattr__(self, "covariance", value)
        else:
            matrix = square_matrix(self.covariance, "covariance")
            least = np.linalg.eigvalsh(matrix).min(initial=0.0)
            if (
                not np.allclose(matrix, matrix.T, rtol=0, atol=1e-12 * np.abs(matrix).max(initial=0.0))
                or least < -1e-12
            ):
                raise RestitutionError("a covariance must be symmetric and positive semidefinite")
            object.__setattr__(self, "covariance", matrix)
        object.__setattr__(self, "seed", checked_seed(self.seed))

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels that the law in the middle is keyed with."""
        return self.law.contact_labels

    @property
    def contact_count(self) -> int | None:
        """Number of contacts that the covariance, or else the law in the middle, is for; None if for any."""
        own = None if np.ndim(self.covariance) == 0 else len(np.asarray(self.covariance))
        return self.law.contact_count if own is None else own

    def seeded(self, seed: int) -> Scattered:
        """Return the law with this seed, if it has none of its own."""
        return replace(self, seed=seed) if self.seed is None else self

    def target(self, collision: Collision) -> Target:
        """Return the contact velocities of the sample that belongs to this collision.

        Raises:
            RestitutionError: the covariance or the law is for another number of contacts.
        """
        v = self.sample(collision, 1, generator(self.seed, collision))[0]
        return Target(collision.contact_velocity_after(v), v)

    def sample(self, collision: Collision, n: int, rng: np.random.Generator | int) -> np.ndarray:
        """Return n independent velocities after the collision, without friction, shape (n, nv).

        Args:
            collision: what collides.
            n: how many, 0 or more.
            rng: a generator, or a seed for one.

        Raises:
            RestitutionError: the covariance or the law is for another number of contacts.
            InvalidCollisionError: n is no whole number, or negative.
        """
        check_number(n)
        c = collision if collision.friction is None else replace(collision, friction=None)
        middle, h = self.law.resolve(c).post_velocity, len(c.labels)
        C = np.asarray(self.covariance)
        if C.ndim and len(C) != h:
            raise RestitutionError(f"the covariance is {C.shape} but {h} contacts collide ({', '.join(c.labels)})")
        if not c.has_admissible_set:
            return np.tile(middle, (n, 1))
        w, V = np.linalg.eigh(C if C.ndim else C * np.eye(h))
        xi = np.random.default_rng(rng).normal(size=(n, h)) @ (V * np.sqrt(np.maximum(w, 0.0))).T
        U, s, Vt = np.linalg.svd(c.dense_gradients, full_matrices=False)
        directions = U[:, s > 1e-12 * s.max(initial=0.0)], Vt[s > 1e-12 * s.max(initial=0.0)]
        delta = c.metric.unwhiten(xi @ directions[0] @ directions[1]) * c.pre_speed
        S = c.admissible_set
        return np.array([S.project(middle + one) for one in delta]).reshape(n, len(middle))
