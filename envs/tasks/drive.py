"""What moves a mocap body: a drive with a stroke and a largest acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt


@dataclass(frozen=True)
class Drive:
    """Moves along a stroke with the acceleration that it is told, and brakes in time before the stroke's ends.

    Attributes:
        stroke: farthest place on both sides of 0, m or rad.
        acceleration: the largest, m/s^2 or rad/s^2.
    """

    stroke: float
    acceleration: float

    def advance(self, place: float, speed: float, part: float, timestep: float) -> tuple[float, float]:
        """Return place and speed after a timestep of constant acceleration.

        Args:
            place: where it is now, m or rad.
            speed: its velocity now, m/s or rad/s.
            part: wanted part of the largest acceleration, -1 .. 1.
            timestep: s.
        """
        wanted = speed + part * self.acceleration * timestep
        highest = self._highest(self.stroke - place, speed, timestep)
        lowest = -self._highest(self.stroke + place, -speed, timestep)
        after = min(max(wanted, lowest), highest)
        return place + 0.5 * (speed + after) * timestep, after

    def _highest(self, room: float, speed: float, timestep: float) -> float:
        """Return the highest speed after a timestep from which the drive can stop within what is left of the room."""
        left = room - 0.5 * speed * timestep
        if left < 0:  # stops within the timestep, and comes back
            return 2.0 * left / timestep
        half = 0.5 * timestep
        return self.acceleration * (sqrt(half**2 + 2.0 * left / self.acceleration) - half)
