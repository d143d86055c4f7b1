"""Pairs that close slowly beside contacts that are held: held too, not met by a collision of their own."""

import math

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.flow import save_state
from impactlaw.rigid import RigidStepping

G, H, HALF, GAP = 9.81, 2e-3, 0.1, 5e-7
FLOOR = '<geom type="plane" size="9 9 1" friction="0.5"/>'
BOX = '<body><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction="0.5"/></body>'


def fly(speed, *, landing, integrator):
    """A box stands on one edge and turns about it; the opposite edge is GAP above the floor and falls at a speed."""
    world = FLOOR + BOX
    model, data = compiled(world, option=f'timestep="{H}" integrator="{integrator}"')
    angle = GAP / (2 * HALF)
    data.qpos[2] = HALF * (math.cos(angle) + math.sin(angle))
    data.qpos[3:7] = math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0
    rate = -speed / (2 * HALF)
    data.qvel[:] = 0.0, -rate * HALF, rate * HALF, rate, 0.0, 0.0
    stepping = Stepper(model, Moreau(0.5))._stepping
    assert isinstance(stepping, RigidStepping)
    flights = stepping._flights
    with flights.options:
        flights.update(data)
        start = flights.look(data)
        state = save_state(model, data)
        flight, closed = flights.fly(data, state, start, H, hold_all=False, landing=landing)
    return start, flight, closed


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize(("part", "landing", "located"), [(0.1, True, False), (0.1, False, True), (3.0, True, True)])
def test_an_edge_lands_where_it_closes_slower_than_gravity_drives_the_other(integrator, part, landing, located):
    """Over a flow of length h it gains 3 g h / 4 while the box turns, so that with g h / 10 it ends below g h."""
    start, flight, closed = fly(part * G * H, landing=landing, integrator=integrator)
    assert np.sort(start.gap) == pytest.approx([0.0, 0.0, GAP, GAP], abs=1e-10)
    assert closed == located
    if not located:
        assert flight.duration == H
        assert flight.arrival.now.gap == pytest.approx(np.zeros(4), abs=1e-9)
        assert flight.arrival.now.contact_velocity.min() > -1e-9
    else:
        assert flight.duration < H
