"""A primal-dual active set method on a banded Delassus matrix, for chains and piles; all contacts start active."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from impactlaw.solvers.methods.banded_delassus import BandedDelassus, Factor
from impactlaw.solvers.problem import Problem, Solution, Status
from impactlaw.solvers.tolerances import DOUBTFUL, ILL, NEAR, REACHED, SHIFTS, SIGNLESS, SINGULAR

_PROXIMAL = 60  # largest number of proximal point steps; each solves definite systems
_GUESSES = 60  # largest number of guesses of the active set
_PATIENCE = 8  # changes without fewer wrong contacts, after which projected gradients look for a better guess
_GRADIENTS = 3000  # largest number of projected gradient steps
_REFINEMENTS = 3  # largest number of steps of iterative refinement


def primal_dual_active_set(problem: Problem) -> Solution:
    """Solve ``Y z >= c``, ``z = Y^T Lambda``, by guessing the contacts that carry an impulse and correcting the guess.

    For a guess, ``G Lambda = c`` on the active contacts and ``Lambda = 0`` on the others. Then contacts with
    ``Lambda < 0`` leave the active set and contacts with ``Y z < c`` enter it. If this no longer improves the guess,
    projected gradients provide another one. If active gradients are dependent, proximal points
    ``(G + s) Lambda' = c + s Lambda``, found in the same way, converge to a solution. Residuals are computed with Y,
    not with G. The numbers of changes and steps are limited; beyond them the status is ``Status.STOPPED``.
    """
    h = len(problem.bound)
    if h == 0 or not (problem.bound > 0).any():
        return Solution(np.zeros(h))
    U = BandedDelassus(problem)
    if U.band.size == 0:
        return Solution(np.zeros(h), Status.STOPPED)
    search = _Search(U, problem.unit[1][U.order], problem.scale)
    scaled = search.run()
    if scaled is None:
        return Solution(np.zeros(h), Status.STOPPED, search.changes)
    impulse = np.zeros(h)
    impulse[U.order] = np.maximum(scaled, 0.0)
    return Solution(impulse / problem.lengths, Status.SOLVED, search.changes)


class _Search:
    """The search for the active contacts of one problem with unit gradients, in the order of the band."""

    def __init__(self, U: BandedDelassus, bound: np.ndarray, scale: float):
        self.U, self.bound, self.scale = U, bound, scale
        self.changes = 0

    def run(self) -> np.ndarray | None:
        """Return the scaled impulses, (h,), or None if no solution is found."""
        active = np.ones(len(self.bound), dtype=bool)
        settled = self._settle(active, 0.0, self.bound)
        if settled is not None and np.linalg.norm(np.minimum(*settled)) <= REACHED * self.scale:
            return settled[0]
        best, least, shift, worse = None, inf, SHIFTS[0], 0
        before = np.zeros_like(self.bound)
        for _ in range(_PROXIMAL):
            settled = self._settle(active, shift, self.bound + shift * before)
            if settled is None:
                break
            before = settled[0]
            active = before > 0
            error = np.linalg.norm(np.minimum(before, self._slack(before, self.bound, 0.0)))
            worse = 0 if error < 0.5 * least else worse + 1
            if error < least:
                best, least = before, error
            if least <= SIGNLESS * self.scale or worse == _PATIENCE:
                break
            shift = max(0.1 * shift, SHIFTS[1])
        return best if least <= REACHED * self.scale else None

    def _settle(self, active: np.ndarray, shift: float, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Solve ``0 <= Lambda  ⊥  (G + shift) Lambda - wanted >= 0``.

        Return Lambda and the slack, or None if a system is singular or no solution is found.
        """
        fewest, patience, helped = len(wanted) + 1, _PATIENCE, False
        for _ in range(_GUESSES):
            factor = self.U.factor(active, shift)
            if factor is None or (shift == 0.0 and factor.least_pivot < SINGULAR):
                return None
            impulse = factor.solve(wanted)
            slack = self._slack(impulse, wanted, shift)
            signed = np.where(active, impulse, slack)
            if signed.min() > -DOUBTFUL * self.scale or factor.least_pivot < ILL:
                impulse, slack = self._refined(factor, active, impulse, wanted, shift)
                signed = np.where(active, impulse, slack)
            wrong = signed < -SIGNLESS * self.scale
            count = np.count_nonzero(wrong)
            if count == 0:
                return impulse, slack
            self.changes += 1
            patience = _PATIENCE if count < fewest else patience - 1
            fewest = min(count, fewest)
            if patience > 0:
                active = active ^ wrong
            elif helped:
                return None
            else:
                active = self._approach(np.maximum(impulse, 0.0), shift, wanted) > 0
                fewest, patience, helped = len(wanted) + 1, _PATIENCE, True
        return None

    def _approach(self, impulse: np.ndarray, shift: float, wanted: np.ndarray) -> np.ndarray:
        """Return a point near the solution by Nesterov's accelerated projected gradients with restarts.

        The acceleration restarts when a step points backwards.
        """
        ahead, t, step = impulse, 1.0, 1.0 / (self.U.largest + shift)
        for count in range(_GRADIENTS):
            slack = self._slack(ahead, wanted, shift)
            if count % 32 == 0 and np.abs(np.minimum(ahead, slack)).max() <= NEAR * self.scale:
                break
            following = np.maximum(ahead - step * slack, 0.0)
            move = following - impulse
            t_following = 0.5 + sqrt(0.25 + t * t)
            if move @ (ahead - following) > 0:
                t = t_following = 1.0
            ahead = np.maximum(following + (t - 1.0) / t_following * move, 0.0)
            impulse, t = following, t_following
        return impulse

    def _refined(
        self, factor: Factor, active: np.ndarray, impulse: np.ndarray, wanted: np.ndarray, shift: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Refine impulses that solve the system on the active contacts; return them and the slack of all contacts."""
        slack = self._slack(impulse, wanted, shift)
        error = np.linalg.norm(slack * active)
        for _ in range(_REFINEMENTS):
            if error <= SIGNLESS * self.scale:
                break
            better = impulse - factor.solve(slack)
            following = self._slack(better, wanted, shift)
            left = np.linalg.norm(following * active)
            if left < error:
                impulse, slack = better, following
            if not left < 0.5 * error:
                break
            error = left
        return impulse, slack

    def _slack(self, impulse: np.ndarray, wanted: np.ndarray, shift: float) -> np.ndarray:
        """Return ``(G + shift) Lambda - wanted``, (h,)."""
        return self.U.product(impulse) - wanted + shift * impulse
