"""A law with scatter: outcomes around those of another law, in the set of possible right-velocities."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, Target, is_semidefinite, number, square_matrix
from impactlaw.laws.drawn.drawing import DrawnLaw
from impactlaw.mechanics.admissible.sampling import check_number, generator_of
from impactlaw.mechanics.collision import Collision, checked

_ROUNDING = 1e-12  # part of the largest variance, or singular value of the gradients, that is rounding


@dataclass(frozen=True, eq=False)
class Scattered(DrawnLaw):
    """``v+ = prox_S(v_law + |v-| delta)``: the law's outcome, moved at random and projected onto S(v-).

    The contact velocities of ``delta`` are ``G^1/2 xi``, where xi is normally distributed with mean 0 and the given
    covariance, so that ``|delta| = |xi|`` in the kinetic metric. This is the covariance of relative errors that
    `identification.fit` reports.

    `sample` draws many outcomes. The outcome of `resolve` is determined by the collision and the seed, see `DrawnLaw`.
    Where S(v-) does not exist, as for surfaces that move against each other or whose velocity jumps, the outcome is
    that of the law, without scatter.

    Attributes:
        law: the law around whose outcome v+ is drawn.
        covariance: the covariance of xi: one variance for all contacts, or a matrix, shape (h, h).

    Raises:
        RestitutionError: ``law`` is not a law without friction, or the covariance or the seed is not valid.
    """

    law: Law
    covariance: ArrayLike
    seed: int | None = field(default=None, kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        if not isinstance(self.law, Law) or self.law.has_friction:
            raise RestitutionError(
                f"Scattered takes a law without friction, got {self.law!r}; friction goes around it: "
                "Coulomb(Scattered(law, covariance))"
            )
        if np.ndim(self.covariance) == 0:
            covariance: Any = number(self.covariance)
            if covariance is None or not 0.0 <= covariance < np.inf:
                raise RestitutionError(f"a variance must be 0 or more, and finite, got {self.covariance!r}")
        else:
            covariance = square_matrix(self.covariance, "covariance")
            if not is_semidefinite(covariance, _ROUNDING):
                raise RestitutionError("a covariance must be symmetric and positive semidefinite")
        object.__setattr__(self, "covariance", covariance)

    def seeded(self, seed: int) -> Scattered:
        """Return the law with this seed, also in the inner law, wherever no seed is set."""
        own, inner = super().seeded(seed), self.law.seeded(seed)
        return own if inner is self.law else replace(own, law=inner)

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels by which the inner law is keyed."""
        return self.law.contact_labels

    @property
    def contact_count(self) -> int | None:
        """Number of contacts that the covariance, or else the inner law, fits; None if any number."""
        return len(np.asarray(self.covariance)) if np.ndim(self.covariance) else self.law.contact_count

    def target(self, collision: Collision) -> Target:
        """Return the sample that belongs to this collision, and its contact velocities."""
        v = self.sample(collision, 1, self.generator(collision))[0]
        return Target(collision.contact_velocity_after(v), v)

    def sample(self, collision: Collision, n: int, rng: np.random.Generator | int) -> np.ndarray:
        """Return n independent velocities after the collision, without friction, (n, nv), from a generator or a seed.

        Raises:
            RestitutionError: the covariance or the law is for another number of contacts.
            InvalidCollisionError: the argument is not a `Collision`, or n or rng is not valid, see
                `AdmissibleSet.sample`.
        """
        check_number(n)
        generator = generator_of(rng)
        c = collision if checked(collision).friction is None else replace(collision, friction=None)
        middle, h = self.law.resolve(c).post_velocity, len(c.labels)
        C = np.asarray(self.covariance)
        if C.ndim and len(C) != h:
            raise RestitutionError(f"the covariance is {C.shape} but {h} contacts collide ({', '.join(c.labels)})")
        if not c.has_admissible_set:
            return np.tile(middle, (n, 1))
        w, V = np.linalg.eigh(C if C.ndim else C * np.eye(h))
        xi = generator.normal(size=(n, h)) @ (V * np.sqrt(np.maximum(w, 0.0))).T
        U, s, Vt = np.linalg.svd(c.dense_gradients, full_matrices=False)
        kept = s > _ROUNDING * s.max(initial=0.0)
        delta = c.metric.unwhiten(xi @ U[:, kept] @ Vt[kept]) * c.pre_speed
        S = c.admissible_set
        return np.array([S.project(middle + one) for one in delta]).reshape(n, len(middle))
