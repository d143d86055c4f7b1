"""The primal-dual active set method alone on a pile, whose active contacts are not found by correcting guesses only."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial import cKDTree

from impactlaw.solvers.methods.primal_dual_active_set import primal_dual_active_set
from impactlaw.solvers.problem import Problem, Status


def hexagonal_pile(side: int, rng: np.random.Generator) -> sp.csr_array:
    """Return whitened gap gradients of disks in a plane, each of which touches up to six others; masses 0.1 to 10."""
    centers = np.array([(x + 0.5 * (y % 2), np.sqrt(0.75) * y) for y in range(side) for x in range(side)])
    pairs = cKDTree(centers).query_pairs(1.0001, output_type="ndarray")
    normals = centers[pairs[:, 1]] - centers[pairs[:, 0]]
    roots = np.sqrt(10.0 ** rng.uniform(-1, 1, len(centers)))
    values = np.hstack([-normals / roots[pairs[:, :1]], normals / roots[pairs[:, 1:]]])
    columns = np.hstack([2 * pairs[:, :1] + [0, 1], 2 * pairs[:, 1:] + [0, 1]])
    rows = np.repeat(np.arange(len(pairs)), 4)
    return sp.csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(pairs), 2 * len(centers)))


@pytest.mark.parametrize("seed", range(4))
def test_a_pile_in_which_every_contact_closes(seed):
    """Restitution differs from contact to contact; without projected gradients the method stops."""
    rng = np.random.default_rng(seed)
    Y = hexagonal_pile(12, rng)
    gamma = -np.abs(Y @ rng.normal(size=Y.shape[1]))
    bound = -(1 + rng.uniform(0, 1, len(gamma))) * gamma
    solution = primal_dual_active_set(Problem(Y, bound))
    assert solution.status == Status.SOLVED
    slack = Y @ (Y.T @ solution.impulse) - bound
    assert (solution.impulse >= 0).all()
    np.testing.assert_allclose(np.minimum(solution.impulse, slack), 0, atol=1e-9)
    assert 0 < np.count_nonzero(solution.impulse) < len(bound)
