"""Poisson's law with Coulomb friction: a compression phase and an expansion phase, each with friction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impactlaw.errors import SolverError
from impactlaw.laws.friction.scaled import Attempt, Outcome
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_gradients
from impactlaw.solvers.friction.problem import ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import shared
from impactlaw.solvers.tolerances import CERTIFIED

_STIFF = 10.0  # relative length of the row of a known share under the relaxation: with it few shifts of offsets suffice
_SHIFTS = 60  # most shifts of these offsets
_SHARED = 1e-12  # allowed error of a share, relative to the largest share
_BITS = 40  # bits kept of the numbers of the problem, so that a change of units does not change them


@dataclass(eq=False)
class TwoPhases(Attempt):
    """Compression and expansion of a collision with friction (Pfeiffer and Glocker, 1996, ch. 8).

    Compression leads to ``gamma_C >= 0`` by impulses in the friction cones, like a law with E = 0. Expansion starts
    from there. Contact i gets ``s e_i Lambda_Ci``, and more if it would be penetrated otherwise,

        0 <= Lambda_E - s e Lambda_C  ⊥  gamma_E >= 0,   |Lambda_Et / mu| <= Lambda_E,

    and friction opposes ``gamma_Et`` as strongly as it can. This is again a cone problem. In it each contact with a
    share and friction appears twice with the same tangential rows: once for the known share, whose normal row acts on a
    separate mass that gives it the impulse ``s e Lambda_C`` exactly, and once for the rest. (Under the convex
    relaxation a share that slides would get more than that, and more friction. Its offset is shifted until it does
    not.) s is 1, or the largest number in [0, 1] with which the two phases create no energy; s = 0 never creates any.
    The surfaces of the collision do not jump: as under `Poisson` they have their velocities after the impact from the
    start.

    Where friction leaves several solutions, rounding and the units of mass and speed would decide between them.
    The problem is therefore solved in units of the collision itself, with numbers rounded so that a change of units
    leaves them the same.
    """

    def outcome(self, s: float, near: ConeAnswer | None = None) -> Outcome:
        """Return the outcome with the coefficients of restitution multiplied by s."""
        given, kick = s * self._share, np.zeros(len(self._rows))
        kick[self._first] = given
        start = self._before + self._rows @ (self._compression.jump + kick @ self._rows)
        twice = np.flatnonzero((given > 0.0) & (self._sizes > 1))
        if len(twice):
            answer, more = self._expansion(start, given, twice)
        else:
            answer = self._phase(self._rows, start, self._sizes)
            more = answer.impulse
        impulse = self._unit_impulse * (self._compression.impulse + kick + more)
        jump, answer = impulse @ self._unrounded, answer._replace(residual=answer.residual * self._unit_speed)
        impact = FrictionImpact.of_cones(self.collision, impulse, jump, restitution_scale=s, exact=self.exact)
        if impact.residual > CERTIFIED:
            raise SolverError(
                f"masses or coefficients of friction of contacts {', '.join(self.collision.labels)} are too different: "
                f"two phases of Poisson's law reached relative residual {impact.residual:.1e}, above {CERTIFIED:g}"
            )
        return Outcome(impact, answer)

    def __post_init__(self):
        """Scale the problem to a longest row and a largest velocity of 1, and round it."""
        c, friction = self.collision, self.collision.friction
        assert friction is not None
        order, self._sizes = c.cone_rows
        self._first = np.cumsum(self._sizes) - self._sizes
        rows = self._unrounded = cone_gradients(c)
        before = np.concatenate([c.pre_contact_velocity, c.pre_sliding_velocity * friction.coefficient])[order]
        longest = np.sqrt(np.maximum.reduceat(np.vecdot(rows, rows), self._first))
        unit_row = longest.max() or 1.0
        lengths = np.repeat(np.where(longest > 0, longest, unit_row), self._sizes)
        unit_speed = max(c.pre_speed, float(np.abs(before / lengths).max())) or 1.0
        mantissa, exponent = np.frexp(lengths / unit_row)
        scale = np.ldexp(_rounded(mantissa), exponent)
        self._rows = _rounded(rows / lengths[:, None]) * scale[:, None]
        self._before = _rounded(before / (lengths * unit_speed)) * scale
        self._speed = _rounded(np.array(c.pre_speed / unit_speed)).item()
        self._unit_speed, self._unit_impulse = unit_speed, unit_speed / unit_row

    @cached_property
    def _compression(self) -> ConeAnswer:
        problem = ConeProblem(self._rows, self._before, self._sizes, exact=self.exact, speed=self._speed)
        answer = self.solved(problem)
        return shared(problem, answer) if problem.is_redundant else answer

    @cached_property
    def _share(self) -> np.ndarray:
        """``e_i Lambda_Ci`` of each contact, (h,)."""
        return self.wanted * np.maximum(self._compression.impulse[self._first], 0.0)

    def _phase(self, rows: np.ndarray, offset: np.ndarray, sizes: np.ndarray) -> ConeAnswer:
        return self.solved(ConeProblem(rows, offset, sizes, exact=self.exact, speed=self._speed))

    def _expansion(self, start: np.ndarray, given: np.ndarray, twice: np.ndarray) -> tuple[ConeAnswer, np.ndarray]:
        """Return the answer of the expansion, and the impulses that it adds to the given normal shares, (n,).

        Args:
            start: contact velocities that include the effect of the given shares, (n,).
            given: the known share of the normal impulse of each contact, (h,).
            twice: indices of the contacts with a share and friction, which appear twice in the problem.
        """
        n, nv = self._rows.shape
        copies = np.concatenate([self._first[i] + np.arange(int(self._sizes[i])) for i in twice])
        ends = np.cumsum(self._sizes[twice])
        own = np.concatenate([[0], ends[:-1]]).astype(int)
        lengths = np.linalg.norm(self._rows[self._first[twice]], axis=1) * (1.0 if self.exact else _STIFF)
        known = np.hstack([self._rows[copies], np.zeros((len(copies), len(twice)))])
        known[own, :nv] = 0.0
        known[own, nv + np.arange(len(twice))] = lengths
        rows = np.vstack([known, np.hstack([self._rows, np.zeros((n, len(twice)))])])
        sizes, offset = np.concatenate([self._sizes[twice], self._sizes]), np.concatenate([start[copies], start])
        offset[own] = -(lengths**2) * given[twice]
        for _ in range(_SHIFTS):
            answer = self._phase(rows, offset, sizes)
            beyond = answer.impulse[own] - given[twice]
            if self.exact or np.abs(beyond).max() <= _SHARED * given.max():
                break
            offset[own] += lengths**2 * beyond
        else:
            raise SolverError(
                f"friction of the expansion of contacts {', '.join(self.collision.labels)} does not settle under the "
                'convex relaxation; take cone="exact"'
            )
        friction, impulse = np.split(answer.impulse, [len(copies)])
        friction[own] = 0.0
        impulse[copies] += friction
        return answer, impulse


def _rounded(numbers: np.ndarray) -> np.ndarray:
    """Return numbers of magnitude at most 1, (..), rounded to `_BITS` bits after the point."""
    return np.ldexp(np.round(np.ldexp(numbers, _BITS)), -_BITS)
