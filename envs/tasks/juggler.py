"""Juggler: a paddle keeps a ball bouncing at a height."""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from impactlaw.envs.tasks.drive import Drive
from impactlaw.envs.tasks.driven import Beginning, DrivenEnv, Numbers
from impactlaw.envs.tasks.scenery import add_target

DRIVE = Drive(stroke=0.25, acceleration=45.0)
"""Drive of the paddle, m and m/s^2."""
LOST = 2.0
"""Height of the ball above which it is lost, m."""


class Juggler(DrivenEnv):
    r"""Move a paddle up and down so that a ball on it keeps bouncing at a height.

    Ball and paddle move on one vertical line. The paddle is a moving surface: its drive determines its motion, and the
    ball cannot push it away. It brakes in time before the ends of its stroke, 0.25 m above and below its initial
    height.

    Observation, `Box(5)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | height of the ball: its gap to the paddle at 0 | m | -0.5 .. 3 |
    | 1 | velocity of the ball, positive upwards | m/s | -10 .. 10 |
    | 2 | height of the paddle, 0 at the start | m | -0.5 .. 0.5 |
    | 3 | velocity of the paddle | m/s | -10 .. 10 |
    | 4 | target height of the ball | m | 0.4 .. 0.8 |

    Action, `Box(1)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | acceleration of the paddle, as a fraction of 45 m/s^2 | 1 | -1 .. 1 |

    Reward: ``max(0, 1 - |H - target| / target)`` every step, where ``H = height + velocity^2 / (2 g)`` is the height
    that the ball's energy can reach: in flight the height of its apex, for a ball at rest nearly 0.

    End: terminated when the ball rises above 2 m and is lost; truncated after 1000 steps (10 s).

    Start: the paddle is at rest, the ball falls from 0.3 .. 1 m, the target is drawn from 0.4 .. 0.8 m.

    What the law changes: the coefficient of restitution determines how fast the paddle has to move up. A ball that
    arrives with speed u leaves with ``v+ = e u + (1 + e) w``. The paddle speed w that returns it with speed u is
    ``u (1 - e) / (1 + e)``: zero for e = 1, 0.11 u for e = 0.8 (the default), and u for e = 0, where the ball stays on
    the paddle until the paddle brakes. There is one contact at a time, so "moreau", "newton" and "reversal" with the
    same e are the same law here.
    """

    SCENE: ClassVar[str] = "juggler"
    LAW: ClassVar[str] = "newton"
    DRIVE: ClassVar[Drive] = DRIVE
    DRIVEN: ClassVar[str] = "paddle"
    FRAME_SKIP: ClassVar[int] = 5
    OBSERVATION: ClassVar = ((1, -0.5, 3.0), (1, -10.0, 10.0), (1, -0.5, 0.5), (1, -10.0, 10.0), (1, 0.4, 0.8))
    ACTION: ClassVar = ((1, -1.0, 1.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add a mark at the target."""
        add_target(spec, 0.0625)

    def start(self) -> None:
        """Begin an episode, and move the mark to its target."""
        super().start()
        mark = self.model.body("target").mocapid[0]
        self.data.mocap_pos[mark] = 0.0, 0.0, self.model.geom("ball").size[0] + self._goal

    def draw(self, rng: np.random.Generator) -> Beginning:
        """Draw the target and the height of the ball."""
        target = float(rng.uniform(0.4, 0.8))
        return Beginning(np.array([rng.uniform(0.3, 1.0)]), np.zeros(1), target)

    @staticmethod
    def move(place: Numbers, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Set the height of the paddle."""
        position[..., 2] = place

    @staticmethod
    def see(qpos: np.ndarray, qvel: np.ndarray, place: Numbers, speed: Numbers, goal: Numbers) -> np.ndarray:
        """Return height and velocity of ball and paddle, and the target."""
        return np.array([qpos[..., 0], qvel[..., 0], place, speed, goal]).T

    def rate(self, qpos: np.ndarray, qvel: np.ndarray, goal: Numbers) -> tuple[Numbers, Numbers]:
        """Reward a ball whose energy would take it to the target."""
        height, velocity = qpos[..., 0], qvel[..., 0]
        reached = height - velocity**2 / (2.0 * self.model.opt.gravity[2])
        return np.maximum(0.0, 1.0 - np.abs(reached - goal) / goal), height > LOST
