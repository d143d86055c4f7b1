"""The impact law of contact springs: the outcome of soft contact in the limit of a collision that takes no time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError, RestitutionError, SolverError
from impactlaw.laws.base import Law, Target, coefficient, is_semidefinite, number
from impactlaw.laws.restitution.labels import OfContacts, checked_values
from impactlaw.mechanics.arrays import finite_array
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.tolerances import SYMMETRY

_STEP = 0.05  # time step times the largest frequency: energy is then conserved to 1e-9
_CREATED = 1e-7  # relative energy created, or closing speed left at the end, above which the steps were too long
_LEAST = 0.01  # restitution below which unloading is too steep to be integrated
_MOST_CONTACTS = 512


@dataclass(frozen=True)
class Compliant(OfContacts, Law):
    """Each contact is a spring, ``f_i = k_i d_i^p``; v+ is the velocity after all contacts have opened again.

    ``d' = -gamma``, ``gamma' = G f``, from ``d = 0, gamma = gamma-`` until every contact is open and separates. The
    bodies do not move meanwhile: this is the limit of ever stiffer soft contact. The outcome needs only G and
    ``gamma-``, is proportional to ``gamma-``, and depends on ratios of stiffness only. Exponent 1.5 is Hertz's
    contact of round bodies, 1 the linear spring. (MuJoCo's contacts are not such springs: each follows its own
    ``r'' + b r' + k r = 0``, independently of the others.)

    With ``restitution`` e below 1 a contact pushes less while it unloads: it opens at ``d = (1 - e^2) d_max``, and a
    single contact returns ``e^2`` of the work (O. Walton and R. Braun, J. Rheol. 30, 1986, for p = 1).

    Time is integrated by a symplectic splitting of order four (S. Blanes and P. Moan, J. Comput. Appl. Math. 142,
    2002), with events located where contacts close and open. The integration changes the energy by a relative 1e-10 or
    so; the impulse is scaled to undo that, so that v+ is in S(v-).

    Attributes:
        stiffness: ``k > 0``, N/m^p: one for all contacts, one per contact, or keyed by contact labels or
            patterns of them.
        exponent: p in [1, 4].
        restitution: e in [0.01, 1], the restitution of each contact by itself.

    Raises:
        RestitutionError: a value is not a number or out of range, a contact has two stiffnesses, or stiffnesses are a
            set, which has no order. In `resolve`: a contact has no stiffness, or stiffnesses are for another number
            of contacts.
        InvalidCollisionError: in `resolve`, more than 512 contacts collide.
        SolverError: in `resolve`, the collision does not come to an end.
    """

    name = "compliant"
    _name = "stiffness"
    description = "contacts are equal Hertzian springs for a moment, each with restitution e; 1 if not given"

    stiffness: float | Sequence[float] | Mapping[str | tuple[str, str], float]
    exponent: float = field(default=1.5, kw_only=True)
    restitution: float = field(default=1.0, kw_only=True)

    def __post_init__(self):
        object.__setattr__(self, "stiffness", checked_values(self.stiffness, "stiffness", _positive, "Compliant"))
        p, e = _positive(self.exponent, "exponent"), coefficient(self.restitution)
        if not 1.0 <= p <= 4.0:
            raise RestitutionError(f"exponent must lie in [1, 4], got {p:g}; Hertz's contact has 1.5")
        if e < _LEAST:
            raise RestitutionError(
                f"restitution of Compliant must be at least {_LEAST}, got {e:g}: a spring that gives nothing back "
                "never opens; MaximalDissipation has restitution 0"
            )
        object.__setattr__(self, "exponent", p)
        object.__setattr__(self, "restitution", e)

    @classmethod
    def of(cls, restitution: Any) -> Compliant:
        """Return the law of equal springs with the restitution given to `make_law`; None means 1."""
        return cls(1.0) if restitution is None else cls(1.0, restitution=restitution)

    def target(self, collision: Collision) -> Target:
        """Return the contact velocities after the springs have opened, and the velocity v+ of the bodies."""
        gamma = collision.pre_contact_velocity
        if collision.surface_jump is not None:
            gamma = gamma + collision.surface_jump
        impulse = self._impulses(collision.delassus, gamma[None], self._stiffness(collision.labels))[0]
        Y = collision.whitened_jacobian
        jump = np.asarray(Y.T.dot(impulse))
        after = gamma + Y.dot(jump)
        after[collision.gradient_norms == 0.0] = 0.0  # no impulse changes these contact velocities
        return Target(after, collision.pre_velocity + collision.metric.unwhiten(jump))

    def impulses(self, delassus: ArrayLike, pre_contact_velocities: ArrayLike) -> np.ndarray:
        """Return the impulses of many collisions of the same contacts at once, (n, h), N s.

        Args:
            delassus: G, shape (h, h).
            pre_contact_velocities: ``gamma-``, shape (n, h), m/s.

        Raises:
            RestitutionError: the stiffness is keyed by labels, or is for another number of contacts.
            InvalidCollisionError: shapes do not fit, entries are not finite numbers, delassus is not symmetric and
                positive semidefinite, or there are more than 512 contacts.
            SolverError: a collision does not come to an end.
        """
        G = finite_array(delassus, "delassus")
        gamma = finite_array(pre_contact_velocities, "pre_contact_velocities")
        if G.ndim != 2 or G.shape[0] != G.shape[1] or gamma.ndim != 2 or gamma.shape[1] != len(G):
            raise InvalidCollisionError(
                f"delassus must be (h, h) and pre_contact_velocities (n, h), got {G.shape} and {gamma.shape}"
            )
        if not is_semidefinite(G, SYMMETRY):
            raise InvalidCollisionError(
                "delassus is not symmetric and positive semidefinite: it is G = J M^-1 J^T, as Collision.delassus is"
            )
        return self._impulses(G, gamma, self._stiffness(tuple(map(str, range(len(G))))))

    def _impulses(self, delassus: Any, gamma: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
        """Return the impulses, (n, h): scale lengths, masses and speeds to order one, and integrate the springs."""
        from impactlaw.mechanics.spring_contacts import spring_impulses

        h = gamma.shape[1]
        if h > _MOST_CONTACTS:
            raise InvalidCollisionError(f"Compliant follows at most {_MOST_CONTACTS} contacts in time, got {h}")
        G = delassus if isinstance(delassus, np.ndarray) else delassus.toarray()
        lengths = np.sqrt(G.diagonal())
        moving = lengths > 0
        lengths, p = lengths[moving], self.exponent
        y = gamma[:, moving] / lengths
        speed = np.abs(y).max(axis=1, initial=0.0)
        speed[speed == 0.0] = 1.0
        y = y / speed[:, None]
        G = np.ascontiguousarray(G[np.ix_(moving, moving)] / np.outer(lengths, lengths))
        np.fill_diagonal(G, 1.0)
        k = stiffness[moving] * lengths ** (p + 1.0)
        k = k / k.max(initial=0.0) if len(k) else k
        energy = 0.5 * np.maximum(np.einsum("ni,ni->n", y, np.linalg.lstsq(G, y.T, rcond=1e-12)[0].T), 1e-300)
        deepest = ((p + 1.0) * energy[:, None] / k) ** (1.0 / (p + 1.0))
        impulse, steps = spring_impulses(G, y, k, p, 1.0 - self.restitution**2, deepest, _STEP)
        with np.errstate(all="ignore"):  # collisions that have not ended may overflow
            created, work = np.einsum("ni,ni->n", impulse, y), np.einsum("ni,ij,nj->n", impulse, G, impulse)
            share = np.where(created + 0.5 * work > 0.0, -2.0 * created / work, 1.0)
            opened = y + share[:, None] * (impulse @ G) > -_CREATED
        if (steps < 0).any() or not (opened.all() and (np.abs(1.0 - share) < _CREATED).all()):
            raise SolverError(
                f"the springs of these {h} contacts do not come to an end: contacts that face each other throw what is "
                "between them to and fro, or stiffness or masses are too far apart; choose another law"
            )
        result = np.zeros_like(gamma)
        result[:, moving] = share[:, None] * impulse * speed[:, None] / lengths
        return result

    def _stiffness(self, labels: tuple[str, ...]) -> np.ndarray:
        found = self._of_contacts(labels, "stiffnesses")
        if None in found:
            raise RestitutionError(f"no stiffness for contact {labels[found.index(None)]}")
        return np.array(found)


def _positive(value: Any, name: str) -> float:
    positive = number(value)
    if positive is None or not 0.0 < positive < np.inf:
        raise RestitutionError(f"{name} must be a positive number, and finite, got {value!r}")
    return positive
