"""Choose the form of the gradients of a problem, array or CSR array, and find groups of coupled contacts."""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.problem import Problem
from impactlaw.solvers.tolerances import COUPLED

_SPARSE_CONTACTS = 64  # contacts from which a sparse factor of G is faster than a dense one
_FILLED = 0.1  # largest fraction of nonzero entries of an array that is treated as sparse
MOST_DENSE = 8_000_000
"""Largest number of entries of a CSR array that is turned into an array for solvers that need one."""


def structured(problem: Problem) -> Problem:
    """Return the problem, with its gradients as a CSR array if they are a large array of mostly zeros."""
    Y = problem.gradients
    if len(problem.bound) < _SPARSE_CONTACTS or problem.is_sparse or np.count_nonzero(Y) > _FILLED * Y.size:
        return problem
    return problem.with_gradients(scipy.sparse.csr_array(Y))


def groups(problem: Problem) -> list[np.ndarray]:
    """Return the indices of contacts, group by group; contacts of different groups are not coupled by G."""
    Y, _ = problem.unit
    return components(np.abs(Y @ Y.T) > COUPLED)


def components(coupled: np.ndarray) -> list[np.ndarray]:
    """Return the connected components of a graph, ascending indices, from its symmetric adjacency, bool (n, n)."""
    n = len(coupled)
    if (np.count_nonzero(coupled, axis=1) == n).any():  # one is coupled with all others; the general way costs 100 us
        return [np.arange(n)]
    count, member = scipy.sparse.csgraph.connected_components(coupled, directed=False)
    return [np.flatnonzero(member == group) for group in range(count)]


def as_dense(problem: Problem, most: int = MOST_DENSE) -> Problem | None:
    """Return the problem with its gradients as an array; None if a CSR array has more than ``most`` entries."""
    if not problem.is_sparse:
        return problem
    h, nv = problem.gradients.shape
    return problem.with_gradients(problem.gradients.toarray()) if h * nv <= most else None
