"""Poisson's law with Coulomb friction: compression, then expansion, each with friction of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from impactlaw.errors import SolverError
from impactlaw.laws.friction.groups import apart, groups_of, joined
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_gradients
from impactlaw.solvers.friction.problem import ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import THOROUGH, Effort, solve_within
from impactlaw.solvers.problem import Status

if TYPE_CHECKING:
    from impactlaw.laws.poisson import Poisson

_CREATED = 1e-12  # energy, relative to the one before, up to which its creation is rounding
_SEARCHES = 40
_NARROW = 1e-9  # bracket of s that is narrow enough
_STIFF = 10.0  # length of a known share's row under the relaxation, so that few moves of its offset will do
_SHIFTS = 60  # moves of it
_SHARED = 1e-12  # of the largest share: what a share may be off
_BITS = 40  # of the numbers that are solved with: what units change by rounding is below the last one


class TwoPhases:
    """Compression and expansion of a collision with friction (Pfeiffer and Glocker, 1996, ch. 8).

    Compression leads to ``gamma_C >= 0`` by impulses in the friction cones, as a law with E = 0. Expansion starts
    there. Contact i gets ``s e_i Lambda_Ci`` and what it needs so as not to be penetrated,

        0 <= Lambda_E - s e Lambda_C  ⊥  gamma_E >= 0,   |Lambda_Et / mu| <= Lambda_E,

    and friction opposes ``gamma_Et`` with all it can. That is a cone problem again: each contact is taken twice, once
    for the share that is known, whose normal row acts on a mass of its own and brings it to ``s e Lambda_C`` exactly,
    and once for the rest; both have the same tangential rows. (The relaxation would give a share that slides more than
    that, and friction with it. Its offset is moved until it does not.) s is 1, or the largest number in [0, 1] with
    which the two phases create no energy; s = 0 never does. The surfaces of the collision do not jump: as under
    `Poisson` they have their velocities after the impact from the start.

    Where friction leaves several solutions, rounding would decide between them, and so would units of mass and speed.
    All is therefore solved in units of the collision itself, with numbers rounded so that others lead to the same.
    """

    def __init__(self, collision: Collision, e: np.ndarray, *, exact: bool, effort: Effort | None):
        self.collision, self.exact, self.effort = collision, exact, effort
        friction = collision.friction
        assert friction is not None
        h = len(collision.labels)
        order, self.sizes = friction.cone_rows(h)
        self.first = np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(int)
        normal, along = collision.pre_contact_velocity, collision.pre_sliding_velocity
        before = np.concatenate([normal, along * friction.coefficient])[order]
        self._use_own_units(cone_gradients(collision), before)
        problem = ConeProblem(self.rows, self.before, self.sizes, exact=exact, speed=self.speed)
        answer = self._solved(problem, "compression")
        self.compression, self.jump = answer.impulse, answer.jump
        self.share = e * np.maximum(self.compression[self.first], 0.0)

    def _use_own_units(self, rows: np.ndarray, before: np.ndarray) -> None:
        """Scale the problem so that the longest row of a contact and the largest velocity are 1, and round it.

        Args:
            rows: gradients where the kinetic metric is Euclidean, (n, nv).
            before: velocities of the rows before the collision, (n,).
        """
        longest = np.sqrt(np.maximum.reduceat(np.vecdot(rows, rows), self.first))
        unit_row = longest.max() or 1.0
        lengths = np.repeat(np.where(longest > 0, longest, unit_row), self.sizes)
        unit_speed = max(self.collision.pre_speed, float(np.abs(before / lengths).max())) or 1.0
        mantissa, exponent = np.frexp(lengths / unit_row)
        scale = np.ldexp(_rounded(mantissa), exponent)
        self.rows = _rounded(rows / lengths[:, None]) * scale[:, None]
        self.before = _rounded(before / (lengths * unit_speed)) * scale
        self.speed = _rounded(np.array(self.collision.pre_speed / unit_speed)).item()
        self._unrounded, self._unit_impulse = rows, unit_speed / unit_row

    def impact(self, impulse: np.ndarray, s: float) -> FrictionImpact:
        """Return the impact of an impulse of `outcome`, with restitution scaled by s."""
        own = self._unit_impulse * impulse
        return FrictionImpact.of_cones(self.collision, own, own @ self._unrounded, scale=s, exact=self.exact)

    def outcome(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return impulse of both phases, contact by contact, (n,), and jump, (nv,), with restitution scaled by s.

        They are in the units of the problem; see `impact`.
        """
        given = s * self.share
        twice = np.flatnonzero((given > 0.0) & (self.sizes > 1))
        kick = np.zeros(len(self.rows))
        kick[self.first] = given
        start = self.before + self.rows @ (self.jump + kick @ self.rows)
        if not len(twice):
            problem = ConeProblem(self.rows, start, self.sizes, exact=self.exact, speed=self.speed)
            answer = self._solved(problem, "expansion")
            impulse = self.compression + kick + answer.impulse
            return impulse, impulse @ self.rows
        impulse = self.compression + kick + self._expansion(start, given, twice)
        return impulse, impulse @ self.rows

    def _expansion(self, start: np.ndarray, given: np.ndarray, twice: np.ndarray) -> np.ndarray:
        """Return what expansion adds to the given shares of normal impulses, (n,).

        Args:
            start: velocities of the rows with these shares, (n,).
            given: shares, (h,).
            twice: contacts with a share and friction, which are taken twice.
        """
        n, nv = self.rows.shape
        copies = np.concatenate([self.first[i] + np.arange(int(self.sizes[i])) for i in twice])
        ends = np.cumsum(self.sizes[twice])
        own = np.concatenate([[0], ends[:-1]]).astype(int)
        lengths = np.linalg.norm(self.rows[self.first[twice]], axis=1) * (1.0 if self.exact else _STIFF)
        known = np.hstack([self.rows[copies], np.zeros((len(copies), len(twice)))])
        known[own, :nv] = 0.0
        known[own, nv + np.arange(len(twice))] = lengths
        rows = np.vstack([known, np.hstack([self.rows, np.zeros((n, len(twice)))])])
        sizes, offset = np.concatenate([self.sizes[twice], self.sizes]), np.concatenate([start[copies], start])
        offset[own] = -(lengths**2) * given[twice]
        for _ in range(_SHIFTS):
            problem = ConeProblem(rows, offset, sizes, exact=self.exact, speed=self.speed)
            answer = self._solved(problem, "expansion").impulse
            beyond = answer[own] - given[twice]
            if self.exact or np.abs(beyond).max() <= _SHARED * given.max():
                break
            offset[own] += lengths**2 * beyond
        else:
            raise SolverError(
                f"friction of the expansion of contacts {', '.join(self.collision.labels)} does not settle under the "
                'convex relaxation; take cone="exact"'
            )
        impulse, friction = answer[len(copies) :].copy(), answer[: len(copies)].copy()
        friction[own] = 0.0
        impulse[copies] += friction
        return impulse

    def created(self, jump: np.ndarray, impulse: np.ndarray) -> np.ndarray:
        """Return the work of the impulses of each contact, (h,), relative to the kinetic energy before."""
        work = np.add.reduceat(impulse * (self.before + 0.5 * (self.rows @ jump)), self.first)
        speed = max(self.speed, float(np.linalg.norm(jump)))
        return 2.0 * work / speed**2 if speed > 0 else np.zeros(len(work))

    def groups(self) -> list[np.ndarray]:
        """Return the contacts that influence each other, group by group."""
        return groups_of(ConeProblem(self.rows, self.before, self.sizes, exact=self.exact, speed=self.speed), None)

    def _solved(self, problem: ConeProblem, phase: str) -> ConeAnswer:
        answer = solve_within(problem, None, THOROUGH, self.effort)
        if answer.status is not Status.SOLVED:
            raise SolverError(
                f"no impulses in the friction cones were found for the {phase} of contacts "
                f"{', '.join(self.collision.labels)}: residual {answer.residual:.1e} sqrt(J)"
            )
        return answer


def resolve_phases(law: Poisson, collision: Collision, *, exact: bool, effort: Effort | None = None) -> FrictionImpact:
    """Return the impact of Poisson's law with friction.

    Args:
        law: with the coefficients.
        collision: with rows of friction.
        exact: exact Coulomb friction, or its convex relaxation.
        effort: limits the work; without it no effort is spared.

    Raises:
        RestitutionError: the coefficients do not fit the contacts.
        SolverError: no answer passed its certificate.
    """
    collision = collision.after_surface_jump
    e, parts = law.coefficients(collision), []
    for contacts, part in apart(collision, law):
        if effort is not None:
            effort.begin_part()
        parts.append((contacts, _resolved(part, e[contacts], exact=exact, effort=effort, alone=False)))
    if parts:
        return joined(collision, parts, exact=exact)
    return _resolved(collision, e, exact=exact, effort=effort, alone=False)


def _resolved(
    collision: Collision, e: np.ndarray, *, exact: bool, effort: Effort | None, alone: bool
) -> FrictionImpact:
    """Return the impact with coefficients, (h,); `alone` are contacts that influence each other."""
    phases = TwoPhases(collision, e, exact=exact, effort=effort)
    impulse, jump = phases.outcome(1.0)
    created = phases.created(jump, impulse)
    if np.maximum(created, 0.0).sum() <= _CREATED:
        return phases.impact(impulse, 1.0)
    groups = [np.arange(len(e))] if alone else phases.groups()
    gaining = [float(created[contacts].sum()) > _CREATED for contacts in groups]
    if not any(gaining):
        return phases.impact(impulse, 1.0)
    if len(groups) == 1:
        return _scaled(phases)
    whole, parts = phases.impact(impulse, 1.0), []
    for contacts, gains in zip(groups, gaining, strict=True):
        if effort is not None:
            effort.begin_part()
        part = collision.part(contacts)
        own = _resolved(part, e[contacts], exact=exact, effort=effort, alone=True) if gains else whole
        parts.append((contacts, own))
    return joined(collision, parts, exact=exact)


def _scaled(phases: TwoPhases) -> FrictionImpact:
    """Return the impact of the largest s found, below 1, with which the two phases create no energy."""
    low, high, (impulse, _) = 0.0, 1.0, phases.outcome(0.0)
    for _ in range(_SEARCHES):
        if high - low <= _NARROW:
            break
        middle = 0.5 * (low + high)
        try:
            found = phases.outcome(middle)
        except SolverError:
            high = middle
            continue
        if phases.created(found[1], found[0]).sum() > _CREATED:
            high = middle
        else:
            low, impulse = middle, found[0]
    return phases.impact(impulse, low)


def _rounded(numbers: np.ndarray) -> np.ndarray:
    """Return numbers of at most 1, (..), without their last bits."""
    return np.ldexp(np.round(np.ldexp(numbers, _BITS)), -_BITS)
