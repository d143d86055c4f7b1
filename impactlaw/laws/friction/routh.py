"""Routh's incremental impact of one contact with friction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from impactlaw.errors import RestitutionError, UnknownNameError, UnsolvableLawError
from impactlaw.laws.base import Law, Target, checked
from impactlaw.laws.friction.routh_impulses import Hypothesis, impulses, phases_of
from impactlaw.laws.restitution.coefficients import Coefficient, Coefficients, ContactCoefficients  # noqa: F401  (types of inherited fields)
from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.mechanics.tolerances import FIXED


@dataclass(frozen=True, repr=False)
class Routh(ContactCoefficients, Law):
    """Coulomb friction at every instant of the impact, as the normal impulse N grows from 0.

    ``d gamma_n = G_nn dN + G_nt dT``, ``d gamma_t = G_tn dN + G_tt dT``, ``dT = -mu dN`` along slip. During the impact
    slip may stop and then stick or reverse, and the contact may jam. Compression ends at N_c, where ``gamma_n = 0``.
    Restitution ends at ``N = (1 + e) N_c`` (Poisson's hypothesis), or when the normal impulse has given back ``e^2`` of
    the work that it has absorbed (Stronge's). With one tangential direction the outcome has a closed form. With two,
    slip changes its direction, and the equation is integrated to some 1e-7 of the speed (E. Routh, *Dynamics of a
    System of Rigid Bodies*, 1905, art. 187; J. Keller, J. Appl. Mech. 53, 1986; Y. Wang and M. Mason, J. Appl. Mech.
    59, 1992; W. Stronge, Proc. R. Soc. A 431, 1990).

    No energy is created: friction dissipates at every instant, and restitution ends at the latest when the kinetic
    energy is back at its value before the impact. Poisson's hypothesis can reach that limit where slip changes.

    The law is for one contact. Several contacts may collide at the same time if they do not influence each other;
    otherwise the collision is refused, since it is not known how their impulses grow together. `Coulomb` around
    `Poisson` takes any number of contacts. The friction is that of the collision; a contact without friction has
    Newton's outcome ``gamma+ = -e gamma-``.

    Attributes:
        restitution: e, see `ContactCoefficients`: a number, one per contact, keyed by label, or a function of speed.
        hypothesis: "poisson" or "stronge".

    Raises:
        RestitutionError: a coefficient is not in [0, 1].
        UnknownNameError: there is no such hypothesis.
    """

    name = "routh"
    description = "friction at every instant of one contact's impact, then e times the impulse of compression"
    has_friction = True

    hypothesis: Hypothesis = field(default="poisson", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        if self.hypothesis not in ("poisson", "stronge"):
            raise UnknownNameError("hypothesis", self.hypothesis, ["poisson", "stronge"])

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, hypothesis={self.hypothesis!r})"

    def target(self, collision: Collision) -> Target:
        """Return the contact velocities after the impact, and the velocity v+ of the bodies."""
        impact = self.resolve(collision)
        return Target(impact.post_contact_velocity, impact.post_velocity)

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the impact; it is a `FrictionImpact` if the collision has friction.

        Raises:
            RestitutionError: the coefficients do not fit the contacts, or contacts influence each other.
            SolverError: the slip of a contact does not settle, or its impulse is not a finite number.
            UnsolvableLawError: a contact closes although no impulse can open it, as where constraints hold its bodies.
            UnknownNameError: ``solver`` is not "auto".
        """
        if solver != "auto":
            raise UnknownNameError("solver of Routh's law", solver, ["auto"])
        c = checked(collision).after_surface_jump
        h, e = len(c.labels), self.coefficients(c)
        rows = np.vstack([c.whitened_jacobian, c.whitened_friction])
        gamma = np.concatenate([c.pre_contact_velocity, c.pre_sliding_velocity])
        owner = np.concatenate([np.arange(h), np.zeros(0, int) if c.friction is None else c.friction.contact])
        mu = np.zeros(0) if c.friction is None else c.friction.coefficient
        _check_apart(c, rows, owner)
        _check_free(c, gamma[:h])
        impulse = np.zeros(len(gamma))
        for i in np.flatnonzero((gamma[:h] < 0.0) & (c.gradient_norms > 0.0)):
            own = np.flatnonzero(owner == i)
            G, along = rows[own] @ rows[own].T, mu[own[1:] - h]
            if len(along):
                phases = phases_of(G, gamma[own[1:]], along, -float(gamma[i]))
                impulse[own] = impulses(G, gamma[own], phases, float(e[i]), self.hypothesis)
            else:
                impulse[i] = -(1.0 + e[i]) * gamma[i] / G[0, 0]
        jump = impulse @ rows
        if not len(mu):
            return Impact(c, c.pre_velocity + c.metric.unwhiten(jump), impulse[:h])
        scaled = np.concatenate([impulse[:h], impulse[h:] / mu])[c.cone_rows.order]
        return FrictionImpact.of_cones(c, scaled, jump)


def _check_free(collision: Collision, gamma: np.ndarray) -> None:
    """Refuse contacts that close although no impulse can open them."""
    c = collision
    speed = abs(c.jacobian) @ np.abs(c.pre_velocity)
    if c.surface_velocity is not None:
        speed = speed + np.abs(c.surface_velocity)
    stuck = (c.gradient_norms == 0.0) & (gamma < -FIXED * speed)
    if stuck.any():
        raise UnsolvableLawError([c.labels[i] for i in np.flatnonzero(stuck)], stuck.astype(float))


def _check_apart(collision: Collision, rows: np.ndarray, owner: np.ndarray) -> None:
    """Refuse contacts that influence each other."""
    lengths = np.linalg.norm(rows, axis=1)
    coupled = np.abs(rows @ rows.T) > INFLUENCE * np.outer(lengths, lengths)
    pairs = np.argwhere(coupled & (owner[:, None] != owner))
    if len(pairs):
        a, b = (collision.labels[owner[i]] for i in pairs[0])
        raise RestitutionError(
            f"Routh's law is for one contact at a time, but {a} and {b} collide together and influence each other: how "
            "their impulses grow together is not known; take Poisson's law, which is for any number"
        )
