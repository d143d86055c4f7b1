"""The point of a polyhedral cone that is nearest to a given point."""

import numpy as np
from certificates import assert_nearest_in_cone
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from impactlaw.solvers import nonnegative_combination


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_nearest_in_cone_satisfies_its_optimality_conditions(data):
    h, n = data.draw(st.integers(0, 8)), data.draw(st.integers(1, 5))
    rows = data.draw(arrays(float, (h, n), elements=st.integers(-2, 2).map(float)))
    rows = rows[np.any(rows != 0, axis=1)]
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    point = data.draw(arrays(float, n, elements=st.floats(-1, 1)))
    weights = nonnegative_combination(rows, point, shared=False)
    assert_nearest_in_cone(rows, point, weights)


def test_nearest_in_cone_of_opposite_rows():
    """Rows together with their opposites, for which nnls of scipy 1.17 is wrong in about 1 of 300 cases."""
    for seed in range(2000):
        rng = np.random.default_rng(seed)
        r = rng.integers(1, 4)
        rows = rng.normal(size=(r, rng.integers(r, 6)))
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        h = rng.integers(r + 1, 9)
        rows = rows[rng.integers(0, r, h)] * rng.choice([1, -1], (h, 1))
        point = rng.normal(size=rows.shape[1])
        weights = nonnegative_combination(rows, point, shared=False)
        assert_nearest_in_cone(rows, point, weights)
