"""Equality constraints next to contacts."""

import numpy as np
import pytest

from impactlaw.scene.equality_constraints import closing_beside


@pytest.mark.parametrize(
    ("gradients", "closing", "wanted"),
    [
        ([[0, 0, 1, 0, 0], [0, 0, 0, 0, 1]], [2.0, 5.0], [2.0, 0.0]),
        ([[0, 0, 1, 0, 0], [0, 0, 0, 1, 1]], [2.0, 5.0], [2.0, 5.0]),
        ([[0, 0, 1, 0, -1], [0, 0, 0, 1, 1]], [2.0, 5.0], [5.0, 5.0]),
        (np.zeros((0, 5)), [], [0.0, 0.0]),
    ],
    ids=["elsewhere", "beside each", "connected", "none"],
)
def test_contacts_are_next_to_constraints_of_bodies_that_they_connect(gradients, closing, wanted):
    """Of five degrees of freedom the first two are of one tree; constraints couple trees 0 and 1, and hold tree 2."""
    constraints, tree = np.array([[1.0, 0, -1, 0, 0], [0, 0, 0, 1, 0]]), np.array([0, 0, 1, 2, 3])
    found = closing_beside(constraints, np.array(gradients, dtype=float), np.array(closing), tree)
    np.testing.assert_array_equal(found, wanted)
