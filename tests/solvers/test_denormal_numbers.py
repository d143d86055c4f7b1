"""Velocities below the smallest normal double, 2e-308, with which scipy's nnls returns wrong impulses, or crashes."""

import numpy as np
import pytest

from impactlaw import Collision, MaximalDissipation, Moreau, Newton, Poisson

# rows from which nnls of scipy 1.16 to 1.17 reads beyond its arrays
ROWS = np.array([
    [0, 0, 0, -1, 1], [-1, -1, 0, 1, 0], [2, 0, -1, 0, 0], [0, 0, 2, -1, 0], [0, 0, 0, 1, 0], [-2, 1, 0, 0, 1],
    [0, 0, 0, -1, 2],
])  # fmt: skip
J = ROWS / np.linalg.norm(ROWS, axis=1)[:, None]
LAWS = {"E = 0": MaximalDissipation(), "moreau": Moreau(0.5), "newton": Newton(0.3), "poisson": Poisson(0.7)}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("exponent", [-800, -960, -1000, -1022, -1040])
def test_outcomes_scale_with_the_velocities(exponent, law):
    unit, scale = -np.ones(5), 2.0**exponent
    expected = law.resolve(Collision(np.eye(5), J, unit)).post_velocity
    found = law.resolve(Collision(np.eye(5), J, scale * unit)).post_velocity
    np.testing.assert_allclose(found, scale * expected, rtol=0.0, atol=1e-12 * scale + 1e-322)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_smallest_number_ends_no_process(law):
    found = law.resolve(Collision(np.eye(5), J, np.full(5, -5e-324))).post_velocity
    assert np.abs(found).max() < 1e-322
