"""Poisson's law, whose coefficients multiply the impulses of a compression phase."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from impactlaw.errors import SolverError, UnsolvableLawError
from impactlaw.laws.base import Law, Target, checked, jump_problem
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.restitution.coefficients import Coefficient, Coefficients, ContactCoefficients  # noqa: F401  (types of inherited fields)
from impactlaw.laws.tolerances import JAMMED_PART, KICK_ROUNDING
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers import Problem, solve_with_jump
from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import row_lengths
from impactlaw.solvers.tolerances import CERTIFIED, GOOD

_REFINEMENTS = 3
_RANKS = (1e-13, 1e-11, 1e-9)  # cutoffs for singular values, relative to the largest, tried one after another


@dataclass(frozen=True, repr=False)
class Poisson(ContactCoefficients, Law):
    """Compression by ``Lambda_C``, the impulse of E = 0, then expansion by at least ``e_i Lambda_Ci`` at contact i.

    ``0 <= Lambda_C  ⊥  gamma_C >= 0`` and ``0 <= Lambda - (1 + e) Lambda_C  ⊥  gamma+ >= 0``, with
    ``v+ = v- + M^-1 J^T Lambda``: a contact gets more than ``(1 + e_i) Lambda_Ci`` only where it would be penetrated
    otherwise (F. Pfeiffer and Ch. Glocker, *Multibody Dynamics with Unilateral Contacts*, Wiley 1996, ch. 8, without
    friction).

    v+ is in S(v-) for all coefficients in [0, 1]: its ``|v- + M^-1 J^T Lambda|`` is the least over all
    ``Lambda >= (1 + e) Lambda_C``, and ``Lambda = 2 Lambda_C`` is one of these and gives ``|v-|``. Equal coefficients
    give Moreau's outcome where that does not penetrate; different coefficients can have distant effects. Where contacts
    are redundant, ``Lambda_C`` is the one of least norm. A surface whose velocity jumps does so before compression: the
    impact's collision has w+ from the start. For the coefficients see `ContactCoefficients`.
    """

    name = "poisson"
    description = "compression, then e_i times its impulse for contact i: coefficients as newton's"

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = 0``, the velocity after impact of contacts that get more than ``(1 + e_i) Lambda_Ci``."""
        return MaximalDissipation().target(collision)

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the impact, see `Law.resolve`; `Impact.compression` is its first phase. ``solver`` is used for both.

        Raises:
            UnsolvableLawError: surfaces that move against each other leave no velocity without penetration.
        """
        collision = checked(collision).after_surface_jump
        e = self.coefficients(collision)
        compression = MaximalDissipation().resolve(collision, solver=solver)
        least = (1.0 + e) * compression.impulse
        target = self.target(collision)
        start, kick = jump_problem(collision, target), least @ collision.whitened_jacobian
        answer = solve_with_jump(_expansion(start, kick), collision.labels, solver=solver)
        v, metric, wanted = collision.pre_velocity, collision.metric, target.contact_velocity
        after, impulse = v + metric.unwhiten(kick + answer.jump), least + answer.impulse
        impact = Impact(collision, after, impulse, wanted, least_impulse=least, compression=compression)
        if _error(impact) > GOOD and isinstance(start.gradients, np.ndarray):
            for rank in _RANKS:
                jump, more = _refined(start, kick + answer.jump, answer.impulse, rank)
                other = replace(impact, post_velocity=v + metric.unwhiten(jump), found_impulse=least + more)
                impact = min(impact, other, key=_error)
        error = _error(impact)
        if not error <= CERTIFIED:
            raise SolverError(
                f"solver {solver!r} reached relative residual {error:.1e} in the expansion of {len(least)} contacts, "
                "which jam; try equal coefficients"
            )
        return impact


def _expansion(start: Problem, kick: np.ndarray) -> Problem:
    """Return the problem of the jump that remains after ``kick``, (nv,), the jump by the least impulses."""
    bound = start.bound - start.gradients @ kick
    rounding = KICK_ROUNDING * start.norms * (start.speed + np.linalg.norm(kick))
    bound = np.where(bound <= rounding, np.minimum(bound, 0.0), bound)
    preimage = None if start.preimage is None else start.preimage - kick
    return Problem(start.gradients, bound, preimage, start.speed, norms=start.norms)


def _error(impact: Impact) -> float:
    """Return the larger of the residual and the relative excess of ``|v+|`` over ``|v-|``."""
    c = impact.collision
    z = c.relative_velocity + impact.whitened_jump
    if c.pre_speed > 0 and z @ z > (1.0 + GOOD) * c.pre_speed**2:
        return max(impact.residual, impact.violations.energetic / c.pre_speed)
    return impact.residual


def _refined(start: Problem, jump: np.ndarray, more: np.ndarray, rank: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the jump, cleared of the rounding of impulses that nearly cancel, and the impulses beyond the least, (h,).

    Contacts with more than the least impulse end at velocity 0. If that makes another contact penetrate, it gets an
    impulse too, and the refinement is repeated. The slack of the compression's problem is the contact velocity;
    singular values below ``rank``, relative to the largest, are treated as rounding.
    """
    labels = ("",) * len(more)
    for _ in range(_REFINEMENTS):
        ending = more > 0
        if not ending.any():
            break
        Y = start.gradients[ending] / start.lengths[ending, None]
        jump = jump - least_squares(Y, start.slack(jump)[ending], rank)
        basis = scipy.linalg.orth(Y.T, rcond=rank)
        others = start.gradients - (start.gradients @ basis) @ basis.T
        others[ending | (row_lengths(others) <= JAMMED_PART * start.norms)] = 0.0
        bound = np.where(others.any(axis=1), -start.slack(jump) * start.lengths, 0.0)
        try:
            answer = solve_with_jump(Problem(others, bound), labels)
        except (UnsolvableLawError, SolverError):
            break
        jump, more = jump + answer.jump, more + answer.impulse
        if not answer.impulse.any():
            break
    return jump, more
