"""A celt, or rattleback, that is spun in one of the two directions reverses its spin, under every rigid way to step."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from scipy.integrate import solve_ivp

from impactlaw import Moreau, Stepper

RIGID = {"event-driven": {}, "time-stepping": {"scheme": "time-stepping"}}
G, SECONDS, TIMESTEP = 9.81, 3.0, 2e-3
MASS, AXES = 0.5, np.array([0.1, 0.02, 0.02])
TURN = np.array([[np.cos(0.15), -np.sin(0.15), 0], [np.sin(0.15), np.cos(0.15), 0], [0, 0, 1]])
SQUARES = AXES**2
INERTIA = TURN @ np.diag(MASS / 5 * (SQUARES.sum() - SQUARES)) @ TURN.T


def lowest(up):
    """Return the vector from the centre of the ellipsoid to the point that touches the ground, in its own frame."""
    return -SQUARES * up / np.sqrt(up @ (SQUARES * up))


def rolling(_, state):
    """Return the rates of the vertical and of the angular velocity w of an ellipsoid that rolls without sliding.

    Its centre has the velocity ``v = r x w``, the ground acts on it at r, and
    ``I w' + w x I w = r x m (v' + w x v + g up)``.
    """
    up, w = state[:3], state[3:]
    turns, r = np.cross(up, w), lowest(up)
    size = np.sqrt(up @ (SQUARES * up))
    r_rate = -SQUARES * turns / size + SQUARES * up * (up @ (SQUARES * turns)) / size**3
    known = np.cross(r_rate, w) + np.cross(w, np.cross(r, w)) + G * up  # the part of the force without w', by mass
    moment = MASS * np.cross(r, known) - np.cross(w, INERTIA @ w)
    around = INERTIA + MASS * ((r @ r) * np.eye(3) - np.outer(r, r))
    return np.concatenate([turns, np.linalg.solve(around, moment)])


@pytest.mark.parametrize("way", RIGID)
@pytest.mark.parametrize(("spin", "end", "tolerance"), [(-3.0, 3.0, 0.05), (3.0, 3.0, 0.005)])
def test_a_celt_turns_back_from_one_spin_only(way, spin, end, tolerance):
    """Its spin about the vertical, rad/s, at four times within 3 s, is compared with that of rolling without losses."""
    inertia = " ".join(str(INERTIA[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    body = f'<inertial pos="0 0 0" mass="{MASS}" fullinertia="{inertia}"/><geom type="ellipsoid" size=".1 .02 .02"/>'
    world = f'<geom type="plane" size="9 9 1"/><body pos="0 0 .02"><freejoint/>{body}</body>'
    model, data = compiled(world, option=f'timestep="{TIMESTEP}" integrator="RK4"', geom='friction="10 0 0"')
    start = np.array([0.02, 0.1, spin])
    up = np.array([0.0, 0.0, 1.0])
    data.qvel[:] = [*np.cross(lowest(up), start), *start]
    times = np.linspace(0.0, SECONDS, 5)
    exact = solve_ivp(rolling, (0.0, SECONDS), np.concatenate([up, start]), t_eval=times, rtol=1e-9, atol=1e-10).y
    stepper, turn, spins = Stepper(model, Moreau(0.0), **RIGID[way]), np.zeros(9), [spin]
    for _ in times[1:]:
        for _ in range(round(times[1] / TIMESTEP)):
            stepper.step(data)
        mujoco.mju_quat2Mat(turn, data.qpos[3:])
        spins.append(turn[6:] @ data.qvel[3:])
    expected = (exact[:3] * exact[3:]).sum(axis=0)
    assert expected[-1] == pytest.approx(end, abs=5e-3)
    np.testing.assert_allclose(spins, expected, atol=tolerance)
