"""Juggler: a paddle keeps a ball bouncing at a height."""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.scenery import add_actuator, add_mark

FORCE = 100.0
"""Largest force on the paddle, N."""
STROKE = 0.25
"""Of the paddle, m, up and down."""
LOST = 2.0
"""Height of the ball above which it is lost, m."""


class Juggler(ImpactEnv):
    r"""Move a paddle up and down so that a ball on it keeps bouncing at a height.

    Ball and paddle move on one vertical line. The paddle (7/8 kg, weightless) hangs in a spring of 40 N/m with 4 N s/m.

    Observation, `Box(5)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | height of the ball: its gap to the paddle at rest | m | -0.5 .. 3 |
    | 1 | velocity of the ball, positive upwards | m/s | -10 .. 10 |
    | 2 | height of the paddle, 0 at rest | m | -0.5 .. 0.5 |
    | 3 | velocity of the paddle | m/s | -10 .. 10 |
    | 4 | target height of the ball | m | 0.4 .. 0.8 |

    Action, `Box(1)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | force on the paddle, as a part of 100 N | 1 | -1 .. 1 |

    Reward: ``max(0, 1 - |H - target| / target)`` every step, where ``H = height + velocity^2 / (2 g)`` is where the
    ball's energy carries it: during a flight the height of its apex, for a ball that lies still nearly 0.

    End: terminated when the ball rises above 2 m, and is lost; truncated after 1000 steps (10 s).

    Start: the paddle rests, the ball falls from 0.3 .. 1 m, the target is drawn from 0.4 .. 0.8 m.

    What the law changes: the coefficient of restitution decides how fast the paddle has to come up. For a ball that
    arrives with u, the speed that sends it back with u is ``(16 / (7 (1 + e)) - 1) u``: 0.14 u for e = 1 (the paddle
    gives way), 0.27 u for e = 0.8 (the default), 1.29 u for e = 0, where the ball stays on the paddle until it brakes.
    One contact at a time, so "moreau", "newton" and "reversal" with the same e are the same law here.
    """

    SCENE: ClassVar[str] = "juggler"
    LAW: ClassVar[str] = "newton"
    FRAME_SKIP: ClassVar[int] = 2
    OBSERVATION: ClassVar = ((1, -0.5, 3.0), (1, -10.0, 10.0), (1, -0.5, 0.5), (1, -10.0, 10.0), (1, 0.4, 0.8))
    ACTION: ClassVar = ((1, -1.0, 1.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the drive of the paddle, the ends of its stroke, and a mark at the target."""
        add_actuator(spec, "paddle", FORCE, (-1.0, 1.0))
        joint = spec.joint("paddle")
        joint.range = (-STROKE, STROKE)
        joint.limited = True
        add_mark(spec, "target", 0.0625)

    def start(self) -> None:
        """Draw target and height of the ball."""
        self._target = float(self.np_random.uniform(0.4, 0.8))
        self.data.joint("height").qpos = self.np_random.uniform(0.3, 1.0)
        self.data.mocap_pos[0] = 0.0, 0.0, self.model.geom("ball").size[0] + self._target

    def act(self, action: np.ndarray) -> None:
        """Push the paddle."""
        self.data.ctrl[:] = action

    def observe(self) -> np.ndarray:
        """Return ball, paddle and target."""
        (paddle, ball), (paddle_velocity, ball_velocity) = self.data.qpos, self.data.qvel
        return np.array([ball, ball_velocity, paddle, paddle_velocity, self._target])

    def judge(self) -> tuple[float, bool]:
        """Reward a ball whose energy carries it to the target."""
        height, velocity = self.data.qpos[1], self.data.qvel[1]
        reached = height - velocity**2 / (2.0 * self.model.opt.gravity[2])
        return max(0.0, 1.0 - abs(reached - self._target) / self._target), height > LOST
