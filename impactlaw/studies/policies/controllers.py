"""Scripted controllers, one per environment: each knows the task's mechanics and one law, and acts on observations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impactlaw.envs.tasks import billiards, juggler, newtons_cradle, rocking_block

Controller = Callable[[np.ndarray], float | tuple[float, float]]
GRAVITY = 9.81


class OnePull:
    """A controller of the cradle: pull the first ball to the target's height, wait until it is at rest, and release it.

    Tuned to "reversal" with e = 1, which passes the height on to the last ball.
    """

    def __init__(self) -> None:
        self._released = False

    def __call__(self, observation: np.ndarray) -> float:
        """Return the pull."""
        angle, speed, target = -observation[0], -observation[5], observation[10]
        wanted = np.arccos(1.0 - target / newtons_cradle.LENGTH)
        self._released |= abs(angle - wanted) < 1e-3 and abs(speed) < 1e-2
        if self._released:
            return -1.0
        hold = GRAVITY * np.sin(wanted)
        return (hold + 20.0 * (wanted - angle) - 8.0 * speed) / newtons_cradle.PULL


@dataclass(frozen=True)
class Hit:
    """A controller of the juggler: hit the ball at mid-stroke with the speed that sends it to the target's height."""

    restitution: float = 0.8  # the e to which it is tuned
    acceleration: float = 40.0  # acceleration with which the paddle gains that speed, m/s^2
    dt: float = 0.01  # duration of a step, s

    def __call__(self, observation: np.ndarray) -> float:
        """Return the acceleration."""
        height, velocity, place, speed, target = observation
        arrival = np.sqrt(max(0.0, velocity**2 + 2.0 * GRAVITY * height))
        time = (velocity + arrival) / GRAVITY
        leaving = np.sqrt(2.0 * GRAVITY * target)
        hit = (leaving - self.restitution * arrival) / (1.0 + self.restitution)  # v+ = e arrival + (1 + e) hit
        left = min(time - self.dt, abs(hit) / self.acceleration)  # time left to gain speed after this step
        a = np.copysign(self.acceleration, hit)
        next_place, next_speed = 0.5 * a * left**2 - hit * left, hit - a * left
        wanted = (next_speed + 15.0 * (next_place - place - self.dt * speed) - speed) / self.dt
        return wanted / juggler.DRIVE.acceleration


@dataclass(frozen=True)
class FullHit:
    """A controller of billiards: hit the first ball full, at the speed with which its neighbors reach the corners."""

    restitution: float = 0.95  # the e of Moreau's law to which it is tuned; the balls leave with ``(1 + e) p``

    def __call__(self, observation: np.ndarray) -> tuple[float, float]:
        """Return angle and speed."""
        contact = observation[2] - 0.0625, observation[3]  # position of the cue ball when it touches ball 1
        angle = np.arctan2(contact[1] - observation[1], contact[0] - observation[0])
        speed = 6.6 / (1.0 + self.restitution)
        slow, fast = billiards.SPEED
        return angle / billiards.WIDEST_AIM, 2.0 * (speed - slow) / (fast - slow) - 1.0


@dataclass(frozen=True)
class Save:
    """A controller of the rocking block: tilt the platform with a block that may topple; leave the rest to impacts.

    Tuned to e = 0, where each change of foot dissipates half of the energy.
    """

    enough: float = 0.8  # energy of the block, relative to that needed to topple, from which it acts
    lead: float = 0.06  # time by which it looks ahead, s
    frequency: float = 19.0  # frequency with which the platform follows, rad/s

    def __call__(self, observation: np.ndarray) -> float:
        """Return the acceleration."""
        tilt, _, angle, turn, _, spin = observation
        falls = angle * spin > 0 and self._energy(abs(angle), spin) >= self.enough
        wanted = angle + self.lead * spin if falls else 0.0
        acceleration = self.frequency**2 * (wanted - tilt) - 1.26 * self.frequency * turn
        return acceleration / rocking_block.DRIVE.acceleration

    @staticmethod
    def _energy(angle: float, spin: float) -> float:
        b, h = rocking_block.HALF_WIDTH, rocking_block.HALF_HEIGHT
        inertia = (b**2 + h**2) / 3.0
        rise = b * np.sin(angle) + h * (np.cos(angle) - 1.0)
        slope = b * np.cos(angle) - h * np.sin(angle)
        return (rise + (inertia + slope**2) * spin**2 / (2.0 * GRAVITY)) / (np.hypot(b, h) - h)


CONTROLLERS: dict[str, type] = {
    "NewtonsCradle-v0": OnePull,
    "Juggler-v0": Hit,
    "Billiards-v0": FullHit,
    "RockingBlock-v0": Save,
}
