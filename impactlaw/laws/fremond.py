"""Laws with a full restitution matrix, in which the velocity of one contact sets the target of another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, RestitutionLaw, Target, coefficient, number, square_matrix
from impactlaw.laws.restitution.labels import canonical, put
from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.arrays import is_sparse
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, eq=False)
class Fremond(RestitutionLaw):
    """``gamma^h = -E gamma-`` with any matrix E, the Frémond matrix of Aeberhard and Glocker.

    Attributes:
        matrix: E, dense or sparse, shape (h, h), for exactly h contacts in their order; or a mapping from pairs of
            contact labels ``(i, j)`` to ``E_ij``, in which entries that are not named are 0. The entry ``(i, i)``
            couples each contact with that label to itself only.

    Raises:
        RestitutionError: the matrix is not square or not finite, or a key is not a pair of contact labels or has two
            values.
    """

    matrix: Any
    name = "fremond"
    description = "E full: any matrix, also keyed by pairs of contact labels"

    @classmethod
    def of(cls, restitution: Any) -> Law:
        """Return the law; refuse a single coefficient, which is not a matrix."""
        if restitution is not None and not isinstance(restitution, Mapping) and np.ndim(restitution) == 0:
            raise RestitutionError("law 'fremond' needs a restitution matrix; 'reversal' takes a single coefficient")
        return super().of(restitution)

    def __post_init__(self):
        if not isinstance(self.matrix, Mapping):
            object.__setattr__(self, "matrix", square_matrix(self.matrix, sparse=True))
            return
        table = {}
        for key, value in self.matrix.items():
            if not isinstance(key, tuple) or len(key) != 2:
                raise RestitutionError(f'a key of Fremond is a pair of contact labels ("b1/b2", "b2/b3"), got {key!r}')
            entry = number(value)
            if entry is None or not np.isfinite(entry):
                raise RestitutionError(f"entry {key} of the restitution matrix must be a finite number, got {value!r}")
            put(table, (canonical(key[0]), canonical(key[1])), entry)
        object.__setattr__(self, "matrix", table)

    @staticmethod
    def reversal(restitution: float = 1.0) -> Reversal:
        """Return the law of Newton's cradle, ``e`` times the anti-identity along chains of contacts."""
        return Reversal(restitution)

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels by which the law is keyed, in canonical form; empty if it has no keys."""
        keys = self.matrix if isinstance(self.matrix, dict) else ()
        return frozenset(name for pair in keys for name in pair)

    @property
    def contact_count(self) -> int | None:
        """Number of contacts that the law fits; None if it fits any number."""
        return None if isinstance(self.matrix, dict) else self.matrix.shape[0]

    def restitution_matrix(self, collision: Collision) -> Any:
        """Return E for the contacts of this collision, shape (h, h)."""
        h = len(collision.labels)
        if not isinstance(self.matrix, dict):
            if self.matrix.shape[0] != h:
                raise RestitutionError(
                    f"restitution matrix is {self.matrix.shape} but {h} contacts collide "
                    f"({', '.join(collision.labels)}); key it by contact labels so that it follows the contacts"
                )
            return self.matrix
        names = [canonical(label) for label in collision.labels]
        E = np.zeros((h, h))
        for i, row in enumerate(names):
            for j, column in enumerate(names):
                if i == j or row != column:
                    E[i, j] = self.matrix.get((row, column), 0.0)
        return E


@dataclass(frozen=True)
class Reversal(RestitutionLaw):
    """``e`` times the anti-identity along chains of contacts: a chain of equal balls passes its velocities on.

    For N equal balls on a line, any number of them launched, v+ is v- in reverse order (e = 1): Newton's cradle.
    Contacts that do not influence each other (separate blocks of the Delassus matrix) are reversed block by block. If a
    block is a chain, in which each contact influences its neighbors only, its contacts may be listed in any order;
    other blocks are reversed in the order in which their contacts are listed.

    Attributes:
        restitution: e in [0, 1].

    Raises:
        RestitutionError: e is not a number in [0, 1].
    """

    restitution: float = 1.0
    name = "reversal"
    description = "E = e times the anti-identity along chains of contacts: Newton's cradle"

    def __post_init__(self):
        object.__setattr__(self, "restitution", coefficient(self.restitution))

    def restitution_matrix(self, collision: Collision) -> Any:
        """Return ``e`` times the anti-identity on every block of connected contacts, shape (h, h); sparse if J is."""
        h, mirror = len(collision.labels), _mirror(collision)
        E = scipy.sparse.csr_array((np.full(h, self.restitution), mirror, np.arange(h + 1)), shape=(h, h))
        return E if is_sparse(collision.jacobian) else E.toarray()

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h_i = -e gamma-_j``, with j the mirror image of i in its block."""
        return Target(-self.restitution * collision.pre_contact_velocity[_mirror(collision)])


def _mirror(collision: Collision) -> np.ndarray:
    """Return for each contact the index of its mirror image in its block, (h,)."""
    G, scale = collision.delassus, collision.gradient_norms
    if (np.abs(G.diagonal(1)) > INFLUENCE * scale[1:] * scale[:-1]).all():  # one block, in order
        return np.arange(len(scale))[::-1]
    G = scipy.sparse.coo_array(G)
    first, second = G.coords
    links = (np.abs(G.data) > INFLUENCE * scale[first] * scale[second]) & (first != second)
    graph = scipy.sparse.csr_array((np.ones(np.count_nonzero(links)), (first[links], second[links])), shape=G.shape)
    count, member = scipy.sparse.csgraph.connected_components(graph, directed=False)
    along = _along_chains(graph, count, member)
    mirror = np.empty_like(along)
    mirror[np.lexsort((along, member))] = np.lexsort((-along, member))
    return mirror


def _along_chains(graph: Any, count: int, member: np.ndarray) -> np.ndarray:
    """Return keys that sort the contacts of each block: along the chain if it is one, else as listed, (h,)."""
    along, degree = np.arange(len(member)), np.diff(graph.indptr)
    ends = degree == 1
    chains = (np.bincount(member[ends], minlength=count) == 2) & (np.bincount(member[degree > 2], minlength=count) == 0)
    for block in np.flatnonzero(chains):
        end = np.flatnonzero(ends & (member == block))[0]
        chain = scipy.sparse.csgraph.breadth_first_order(graph, end, directed=False, return_predecessors=False)
        along[chain] = np.arange(len(chain))
    return along
