"""Bodies at rest: the forces that held all contacts over one step, applied over the next one.

At the end of a step that has moved nothing, the impulse ``P = M (v+ - v)`` that the contacts have given to the flow is
known. The next flow gets ``P / tau`` as an applied force. If nothing has moved at its end, neither in position nor in
velocity, then the same contacts are closed, their forces lie in the same cones as before, and the step is done: no gap
has to be measured and no problem to be solved. Otherwise the flow is forgotten, and the step taken as any other.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.detection import Pattern
from impactlaw.flight import Flights
from impactlaw.flow import restore_state, save_state, saved_qpos
from impactlaw.moment import CORRECTED, SILENT, Moment


class Rest(NamedTuple):
    """A configuration in which nothing moves.

    Attributes:
        qpos: where the contacts were looked at, (nq,).
        force: that the contacts exert on all degrees of freedom, N or N m, (nv,).
        distance: that no coordinate can move by without a gap changing by more than a correction, m or rad.
        speed: of all coordinates together, below which every contact velocity is rounding, m/s or rad/s.
        pattern: of the contacts there.
    """

    qpos: np.ndarray
    force: np.ndarray
    distance: float
    speed: float
    pattern: Pattern

    def lasts(self, model: mujoco.MjModel, data: mujoco.MjData, flights: Flights, state: np.ndarray) -> bool:
        """Advance from a saved state by a timestep if nothing moves in it; return whether it did."""
        applied = data.qfrc_applied
        own = applied.copy()
        applied += self.force
        flights.advance(data, flights.options.timestep)
        applied[:] = own
        moved = _difference(model, self.qpos, data.qpos)
        if mujoco.mju_norm(moved) <= self.distance and mujoco.mju_norm(data.qvel) <= self.speed:
            flights.refresh(data, self.pattern)
            return True
        restore_state(model, data, state)
        return False


def is_still(flights: Flights, moment: Moment, velocity: np.ndarray) -> bool:
    """Return whether all contacts are still, at a moment and at another velocity, (nv,)."""
    speed = _speed(flights, moment)
    return mujoco.mju_norm(moment.velocity) <= speed and mujoco.mju_norm(velocity) <= speed


def find_rest(
    model: mujoco.MjModel, data: mujoco.MjData, flights: Flights, state: np.ndarray, end: Moment
) -> Rest | None:
    """Return the rest in which a step without collisions has ended still; None if it has moved something.

    Args:
        model: the scene.
        data: at the end of the step, whose velocities at both ends are still.
        flights: what has taken it.
        state: at its start.
        end: the contacts at its end.
    """
    qpos, timestep = data.qpos.copy(), flights.options.timestep
    distance = CORRECTED * flights.tolerance / _farthest(flights)
    if mujoco.mju_norm(_difference(model, saved_qpos(model, state), qpos)) > distance:
        return None
    after = save_state(model, data)
    restore_state(model, data, state)
    flights.advance(data, timestep)
    change = end.velocity - data.qvel
    restore_state(model, data, after)
    flights.update(data)
    flights.refresh(data, end.touch.pattern)
    force = np.empty(model.nv)
    mujoco.mj_mulM(model, data, force, change / timestep)
    return Rest(qpos, force, distance, _speed(flights, end), end.touch.pattern)


def _farthest(flights: Flights) -> float:
    """Return how much two points in contact can move against each other, m per unit of all coordinates together."""
    return 2.0 * max(flights.farthest, 1.0)


def _speed(flights: Flights, moment: Moment) -> float:
    return SILENT * moment.still / _farthest(flights)


def _difference(model: mujoco.MjModel, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the displacement from one configuration to another, (nv,)."""
    result = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, result, 1.0, one, other)
    return result
