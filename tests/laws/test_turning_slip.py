"""Routh's impact law with turning slip, against an integration of its equation by scipy's Runge-Kutta method."""

import numpy as np
import pytest
from laws.frictional import delassus_with_friction, one_contact
from scipy.integrate import solve_ivp

from impactlaw import Collision, Routh


def integrated(c: Collision, e: float, hypothesis: str) -> np.ndarray | None:
    """Return v+ by scipy's method of order eight, over normal impulse; None if slip stops on the way."""
    G, gamma = delassus_with_friction(c)
    assert c.friction is not None
    mu, k = c.friction.coefficient, len(gamma)

    def rates(N, x):
        u = x[1:k]
        f = np.append(1.0, -(mu**2) * u / np.linalg.norm(mu * u))
        return np.concatenate([G @ f, f[1:], [x[0]]])  # rates of gamma, of the friction impulse, of the normal work

    def slows(N, x):
        return np.linalg.norm(x[1:k]) - 0.1 * np.linalg.norm(gamma[1:])

    slows.terminal = True  # pyright: ignore[reportFunctionMemberAccess]

    def reaches(begin, x, value, last):
        value.terminal, value.direction = True, 1.0
        way = solve_ivp(rates, (begin, last), x, events=[value, slows], method="DOP853", rtol=1e-11, atol=1e-13)
        return (np.nan, x) if len(way.t_events[1]) else (way.t[-1], way.y[:, -1])

    far = -20.0 * gamma[0] / G[0, 0]
    N_c, x = reaches(0.0, np.concatenate([gamma, np.zeros(k)]), lambda N, x: x[0], far)
    if not np.isfinite(N_c) or abs(x[0]) > 1e-9:
        return None
    x[0], work = 0.0, x[-1]
    if hypothesis == "poisson":
        N, x = reaches(N_c, x, lambda N, x: N - (1.0 + e) * N_c, (1.0 + e) * N_c * (1.0 + 1e-12))
    else:
        N, x = reaches(N_c, x, lambda N, x: x[-1] - (1.0 - e * e) * work, far)
    if not np.isfinite(N):
        return None
    J = np.vstack([c.jacobian, c.friction.jacobian])
    return c.pre_velocity + np.linalg.solve(c.mass_matrix, J.T @ np.concatenate([[N], x[k : 2 * k - 1]]))


@pytest.mark.parametrize("hypothesis", ["poisson", "stronge"])
def test_against_an_integration(hypothesis):
    """Compression and restitution end within steps. Regression: with a step's mean friction, v+ was off by 1e-5."""
    compared = 0
    for seed in range(30):
        rng = np.random.default_rng([13, seed])
        c = one_contact(rng, 2, largest=0.6)
        e = rng.uniform(0.1, 0.9)
        expected = integrated(c, e, hypothesis)
        if expected is None or expected @ c.mass_matrix @ expected > 2.0 * c.kinetic_energy:
            continue
        compared += 1
        found = Routh(e, hypothesis=hypothesis).resolve(c).post_velocity
        assert c.metric.norm(found - expected) < 2e-7 * c.pre_speed
    assert compared > 8
