"""What moves a mocap body: a drive with a stroke and a largest acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

_SINGLE: tuple[Any, ...] = min, max, sqrt
_MANY: tuple[Any, ...] = np.minimum, np.maximum, np.sqrt


@dataclass(frozen=True)
class Drive:
    """Moves along a stroke with the acceleration that it is told, and brakes in time before the stroke's ends.

    Attributes:
        stroke: farthest place on both sides of 0, m or rad.
        acceleration: the largest, m/s^2 or rad/s^2.
    """

    stroke: float
    acceleration: float

    def advance(self, place: Any, speed: Any, part: Any, timestep: float) -> tuple[Any, Any]:
        """Return place and speed after a timestep of constant acceleration; of one drive, or arrays of many.

        Args:
            place: where it is now, m or rad.
            speed: its velocity now, m/s or rad/s.
            part: wanted part of the largest acceleration, -1 .. 1.
            timestep: s.
        """
        wanted = speed + part * self.acceleration * timestep
        least, most, _ = functions = _SINGLE if isinstance(place, float) else _MANY
        highest = self._highest(self.stroke - place, speed, timestep, functions)
        lowest = -self._highest(self.stroke + place, -speed, timestep, functions)
        after = least(most(wanted, lowest), highest)
        return place + 0.5 * (speed + after) * timestep, after

    def _highest(self, room: Any, speed: Any, timestep: float, functions: tuple[Any, ...]) -> Any:
        """Return the highest speed after a timestep from which the drive can stop within what is left of the room."""
        least, most, root = functions
        left = room - 0.5 * speed * timestep
        half = 0.5 * timestep
        stopping = self.acceleration * (root(half**2 + 2.0 * most(left, 0.0) / self.acceleration) - half)
        back = 2.0 * least(left, 0.0) / timestep  # it stops within the timestep, and comes back
        return stopping + back
