"""Rocking block: tilt the ground so that a block that rocks on two feet does not topple."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlaw.envs.tasks.drive import Drive
from impactlaw.envs.tasks.driven import Beginning, DrivenEnv, Numbers

DRIVE = Drive(stroke=0.25, acceleration=70.0)
"""Drive of the platform's tilt, rad and rad/s^2."""
TOPPLED = 0.5
"""Angle of the block, rad, beyond which it counts as toppled: twice the angle beyond which it falls by itself."""
HALF_WIDTH, HALF_HEIGHT = 0.125, 0.5
"""Half the distance between the feet of the block, and the height of its center above them, m."""


class RockingBlock(DrivenEnv):
    r"""Tilt the ground so that a slender block that has started to rock does not topple.

    Contacts have no friction, so ground that moves sideways would slide away under the feet. Instead, the block is
    guided at its center (it can move up and down and turn) and the ground is a platform that tilts. Its reaction force
    tilts with it and turns the block, as the reaction of ground that moves sideways would. The platform is a moving
    surface that turns about a line below the block. Its drive determines its motion, and the block cannot push it away.
    It brakes in time before the ends of its stroke, 0.25 rad to either side.

    Observation, `Box(6)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | tilt of the platform, positive to the right | rad | -1 .. 1 |
    | 1 | rise of the block's center | m | -0.5 .. 0.5 |
    | 2 | angle of the block, positive to the right | rad | -1 .. 1 |
    | 3 | angular velocity of the platform | rad/s | -20 .. 20 |
    | 4 | velocity of the block's center, positive upwards | m/s | -10 .. 10 |
    | 5 | angular velocity of the block | rad/s | -20 .. 20 |

    Action, `Box(1)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | angular acceleration of the platform, as a fraction of 70 rad/s^2 | 1 | -1 .. 1 |

    Reward: ``max(0, 1 - |angle| / 0.5)`` every step, 1 for a block that stands upright.

    End: terminated when the block has toppled, beyond 0.5 rad; truncated after 250 steps (5 s).

    Start: the block stands on one foot, the left or the right one, tilted by 0.05 .. 0.1 rad and turning outwards with
    1.1 to 1.4 times the energy that it takes to topple.

    What the law changes: how much of the rocking motion remains when the block changes feet. With e = 0 ("moreau" 0,
    the default) the block changes feet without bouncing and loses half of its energy. With "moreau", e > 0, both feet
    leave the ground and the block hops. "reversal" exchanges the feet and keeps the rocking motion, so that a block
    that was saved on one side rocks to the other side as fast as before.
    """

    SCENE: ClassVar[str] = "rocking_platform"
    LAW: ClassVar[str] = "moreau"
    DRIVE: ClassVar[Drive] = DRIVE
    DRIVEN: ClassVar[str] = "platform"
    FRAME_SKIP: ClassVar[int] = 8
    OBSERVATION: ClassVar = (
        (1, -1.0, 1.0), (1, -0.5, 0.5), (1, -1.0, 1.0), (1, -20.0, 20.0), (1, -10.0, 10.0), (1, -20.0, 20.0),
    )  # fmt: skip
    ACTION: ClassVar = ((1, -1.0, 1.0),)

    def draw(self, rng: np.random.Generator) -> Beginning:
        """Draw a block on one foot that is going to topple."""
        side = rng.choice([-1.0, 1.0])
        angle, excess = rng.uniform(0.05, 0.1), rng.uniform(1.1, 1.4)
        b, h = HALF_WIDTH, HALF_HEIGHT
        body = self.model.body("block").id
        mass, inertia = self.model.body_mass[body], self.model.body_inertia[body, 1]
        rise = b * np.sin(angle) + h * (np.cos(angle) - 1.0)
        slope = b * np.cos(angle) - h * np.sin(angle)
        missing = mass * -self.model.opt.gravity[2] * (excess * (np.hypot(b, h) - h) - rise)
        spin = np.sqrt(2.0 * missing / (inertia + mass * slope**2))
        return Beginning(np.array([rise, side * angle]), np.array([slope * spin, side * spin]), 0.0)

    @staticmethod
    def move(place: Numbers, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Tilt the platform."""
        quaternion[..., 0], quaternion[..., 2] = np.cos(0.5 * place), np.sin(0.5 * place)

    @staticmethod
    def see(qpos: np.ndarray, qvel: np.ndarray, place: Numbers, speed: Numbers, goal: Numbers) -> np.ndarray:
        """Return positions and velocities of platform and block."""
        return np.array([place, qpos[..., 0], qpos[..., 1], speed, qvel[..., 0], qvel[..., 1]]).T

    def rate(self, qpos: np.ndarray, qvel: np.ndarray, goal: Numbers) -> tuple[Numbers, Numbers]:
        """Reward a block that stands upright."""
        angle = np.abs(qpos[..., 1])
        return np.maximum(0.0, 1.0 - angle / TOPPLED), angle > TOPPLED
