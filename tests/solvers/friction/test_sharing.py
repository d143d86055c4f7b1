"""Redundant contacts with friction share impulses equally."""

import numpy as np
import scipy

from impactlaw import Collision, Coulomb, Friction, Moreau


def boxes(velocities):
    """Return boxes of 1 kg, each of which lands flat on four rough corners, with these velocities, (n, 6)."""
    n = len(velocities)
    normals, tangents = [], []
    for i in range(n):
        for x, y in ((-0.1, -0.1), (-0.1, 0.1), (0.1, -0.1), (0.1, 0.1)):
            rows = np.zeros((3, 6 * n))
            rows[:, 6 * i : 6 * i + 3] = np.eye(3)
            rows[:, 6 * i + 3 : 6 * i + 6] = [np.cross([x, y, -0.1], axis) for axis in np.eye(3)]
            normals.append(rows[2])
            tangents += [rows[0], rows[1]]
    friction = Friction(np.array(tangents), np.repeat(np.arange(4 * n), 2), np.full(8 * n, 0.6))
    inertia = np.kron(np.eye(n), np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]))
    return Collision(inertia, np.array(normals), velocities.reshape(-1), friction=friction)


def test_bodies_that_do_not_feel_each_other_share_each_by_themselves(monkeypatch):
    """Regression: a thousand contacts of boxes side by side took minutes as one dense problem."""
    sizes = []
    solve = scipy.linalg.lstsq

    def counted(system, *given, **options):
        sizes.append(len(system))
        return solve(system, *given, **options)

    velocities = [0.3, 0.1, -1.0, 0.0, 0.2, 0.1] + 0.05 * np.random.default_rng(0).normal(size=(5, 6))
    alone = [Coulomb(Moreau(0.5)).resolve(boxes(one[None])) for one in velocities]
    monkeypatch.setattr(scipy.linalg, "lstsq", counted)
    together = Coulomb(Moreau(0.5)).resolve(boxes(velocities))
    assert sizes == [12] * 5
    assert together.residual < 1e-12
    for name in ("impulse", "friction_impulse"):
        parts = np.concatenate([getattr(impact, name) for impact in alone])
        np.testing.assert_allclose(getattr(together, name), parts, atol=1e-10)
