"""A contact problem with friction as a time step poses it, and the measure of how far impulses are from solving it.

`scaled` divides the rows of Y and the offsets by the length of their group's longest row, so that velocities u and
impulses x are in sqrt(J), and solvers can be compared independently of the units of a scene.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from impactlaw.solvers.cones import BOX, CONE
from impactlaw.solvers.cones.rows import Problem as Fields

_NOTHING = 1e-10
"""Groups whose rows are shorter than this part of the longest row cannot move a body; they are left out."""
_CARRIES, _SLIDES = 1e-9, 1e-6  # parts of the scale above which a contact carries an impulse, and slides
_SINGULAR = 1e-10  # part of the largest eigenvalue up to which the smallest counts as zero


@dataclass(frozen=True, eq=False)
class Problem:
    """Find x with ``u = Y Y^T x + c x + b`` and, group by group, one of three complementarities.

    Cones: ``K ∋ x  ⊥  u + |u_t| e_n ∈ K`` with ``K = {(a, y) : |y| <= a}``, without ``|u_t| e_n`` in the convex
    relaxation. Boxes: ``|x| <= bound``, and u opposes x where it is at the bound. Bilateral rows: ``u = 0``.

    Attributes:
        scene: name of the scene that it comes from.
        rows: Y, (n, nv).
        tree: kinematic tree of each degree of freedom, int32 (nv,).
        size: number of rows of each group, int32 (g,).
        kind: `BILATERAL`, `BOX` or `CONE`, int32 (g,).
        bound: bounds of the boxes, (g,).
        compliance: c, (n,).
        offset: b, (n,).
        guess: impulses that the scheme starts from, (n,).
        exact: whether Coulomb friction is exact, or else its convex relaxation.
        rounds: rounds that the scheme allows the compiled solver where Newton's method fails.
    """

    scene: str
    rows: Any
    tree: np.ndarray
    size: np.ndarray
    kind: np.ndarray
    bound: np.ndarray
    compliance: np.ndarray
    offset: np.ndarray
    guess: np.ndarray
    exact: bool
    rounds: int

    @property
    def fields(self) -> Fields:
        """The problem as compiled functions take it."""
        Y = self.rows
        return Fields(
            np.diff(Y.indptr), Y.indptr[:-1].copy(), Y.indices, Y.data, self.tree, self.first, self.size, self.kind,
            self.bound, self.compliance, self.offset, self.exact,
        )  # fmt: skip

    @cached_property
    def first(self) -> np.ndarray:
        """First row of each group, int32 (g,)."""
        return (np.cumsum(self.size) - self.size).astype(np.int32)

    @cached_property
    def _place(self) -> tuple[np.ndarray, np.ndarray]:
        group = np.repeat(np.arange(len(self.size)), self.size)
        return group, np.arange(len(group)) - self.first[group]

    @cached_property
    def scale(self) -> float:
        """The largest ``|b|`` of a group, sqrt(J)."""
        return float(np.linalg.norm(self.padded(self.offset), axis=1).max(initial=0.0))

    def padded(self, x: np.ndarray) -> np.ndarray:
        """Return the entries by group, padded with zeros, (g, largest size)."""
        out = np.zeros((len(self.size), int(self.size.max(initial=1))))
        out[self._place] = x
        return out

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Return u, (n,)."""
        return self.rows @ (self.rows.T @ x) + self.compliance * x + self.offset

    def slips(self, x: np.ndarray) -> np.ndarray:
        """Return ``|u_t|`` of each group, (g,)."""
        return np.linalg.norm(self.padded(self.velocity(x))[:, 1:], axis=1)

    def delassus(self) -> np.ndarray:
        """Return ``Y Y^T`` with the compliance on its diagonal, (n, n)."""
        return (self.rows @ self.rows.T).toarray() + np.diag(self.compliance)

    def natural_map(self, x: np.ndarray) -> float:
        """Return the largest ``|x - P(x - u - |u_t| e_n)|`` of a group, relative to the scale; infinite for NaN.

        P is the projection onto the admissible set of the group. The result is 0 if and only if x solves the problem.
        """
        u = self.padded(self.velocity(x))
        impulse = self.padded(x)
        y = impulse - u
        cone, box = self.kind == CONE, self.kind == BOX
        if self.exact:
            y[cone, 0] -= np.linalg.norm(u[cone, 1:], axis=1)
        nearest = y.copy()
        nearest[cone] = _nearest_in_cone(y[cone])
        nearest[box, 0] = np.clip(y[box, 0], -self.bound[box], self.bound[box])
        missed = float(np.linalg.norm(impulse - nearest, axis=1).max(initial=0.0)) / self.scale
        return missed if missed >= 0.0 else np.inf

    def slides(self, x: np.ndarray) -> bool:
        """Return whether a contact that carries an impulse slides."""
        carries = (self.kind == CONE) & (self.padded(x)[:, 0] > _CARRIES * self.scale)
        return bool((carries & (self.slips(x) > _SLIDES * self.scale)).any())

    def is_singular(self) -> bool:
        """Return whether the Delassus matrix is singular, so that impulses need not be unique."""
        moved = len(np.unique(self.rows.indices))
        if len(self.offset) - np.count_nonzero(self.compliance) > moved:
            return True
        eigenvalues = np.linalg.eigvalsh(self.delassus())
        return bool(eigenvalues[0] <= _SINGULAR * eigenvalues[-1])


def _nearest_in_cone(y: np.ndarray) -> np.ndarray:
    """Return the nearest points of K, row by row."""
    normal, length = y[:, 0], np.linalg.norm(y[:, 1:], axis=1)
    surface = 0.5 * np.maximum(normal + length, 0.0)
    reached = np.where(length <= normal, normal, surface)
    shrunk = np.where(length <= normal, 1.0, surface / np.where(length > 0.0, length, 1.0))
    return np.column_stack([reached, y[:, 1:] * shrunk[:, None]])


def scaled(problem: Problem) -> Problem:
    """Return the problem with its groups scaled, and without groups that cannot move."""
    rows, size = problem.rows, problem.size
    longest = np.sqrt(np.maximum.reduceat(np.asarray(rows.multiply(rows).sum(axis=1)).reshape(-1), problem.first))
    soft = np.sqrt(np.maximum.reduceat(problem.compliance, problem.first))
    length = np.where(longest > _NOTHING * longest.max(initial=0.0), longest, soft)
    moves = length > 0.0
    kept = np.repeat(moves, size)
    each = np.repeat(length, size)[kept]
    chosen = sparse.csr_array(sparse.diags_array(1.0 / each) @ rows[kept])
    chosen.eliminate_zeros()
    return replace(
        problem,
        rows=chosen,
        size=size[moves],
        kind=problem.kind[moves],
        bound=problem.bound[moves] * length[moves],
        compliance=problem.compliance[kept] / each**2,
        offset=problem.offset[kept] / each,
        guess=problem.guess[kept] * each,
    )
