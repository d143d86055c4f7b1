"""A drive that moves a mocap body, with limited stroke and acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

_SINGLE: tuple[Any, ...] = min, max, sqrt
_MANY: tuple[Any, ...] = np.minimum, np.maximum, np.sqrt


@dataclass(frozen=True)
class Drive:
    """A drive that follows a commanded acceleration, and brakes in time before the ends of its stroke."""

    stroke: float  # largest position on either side of 0, m or rad
    acceleration: float  # largest acceleration, m/s^2 or rad/s^2

    def advance(self, place: Any, speed: Any, part: Any, timestep: float) -> tuple[Any, Any]:
        """Return position and velocity after a timestep of constant acceleration, of one drive or of arrays of drives.

        Args:
            place: present position, m or rad.
            speed: present velocity, m/s or rad/s.
            part: commanded acceleration as a fraction of the largest one, -1 .. 1.
            timestep: timestep, s.
        """
        wanted = speed + part * self.acceleration * timestep
        least, most, _ = functions = _SINGLE if isinstance(place, float) else _MANY
        highest = self._highest(self.stroke - place, speed, timestep, functions)
        lowest = -self._highest(self.stroke + place, -speed, timestep, functions)
        after = least(most(wanted, lowest), highest)
        return place + 0.5 * (speed + after) * timestep, after

    def _highest(self, room: Any, speed: Any, timestep: float, functions: tuple[Any, ...]) -> Any:
        """Return the highest velocity after a timestep from which the drive can stop within the remaining stroke.

        Args:
            room: distance to the end of the stroke, m or rad.
            speed: present velocity towards that end, m/s or rad/s.
            timestep: timestep, s.
            functions: minimum, maximum and square root, for numbers or arrays.
        """
        least, most, root = functions
        left = room - 0.5 * speed * timestep
        half = 0.5 * timestep
        stopping = self.acceleration * (root(half**2 + 2.0 * most(left, 0.0) / self.acceleration) - half)
        back = 2.0 * least(left, 0.0) / timestep  # it stops within the timestep, and moves back
        return stopping + back
