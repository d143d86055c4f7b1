"""Newton's cradle: pull the first ball so that the last one reaches a height."""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.tasks.scenery import add_target

PULL = 6.0
"""Largest torque of the string that pulls the first ball, N m; it can hold the ball at 38 degrees."""
LENGTH = 1.0
"""Length of the pendulums, m."""
CLOSE = 0.95
"""Closeness of the last ball's apex to the target at which an episode ends."""


class NewtonsCradle(ImpactEnv):
    r"""Pull the first of five hanging balls away from the others and let go, so that the last one reaches a height.

    The string can only pull, so only collisions can raise the last ball.

    Observation, `Box(12)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0-4 | angle of ball 1 .. 5, 0 when it hangs, positive away from ball 1's side | rad | -2 .. 2 |
    | 5-9 | its angular velocity | rad/s | -10 .. 10 |
    | 10 | target: rise of the last ball | m | 0.02 .. 0.12 |
    | 11 | closeness of its best apex so far | 1 | 0 .. 1 |

    Action, `Box(1)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | pull on ball 1, away from the others, as a fraction of 6 N m; below 0 the string is slack | 1 | -1 .. 1 |

    Reward: the increase of the best closeness in this step. Closeness is measured at each apex of the last ball, as
    ``max(0, 1 - |rise - target| / target)``, so that the return is at most 1.

    End: terminated when the closeness reaches 0.95, or when a ball rises above its hinge (its strings would go slack);
    truncated after 300 steps (6 s).

    Start: the balls hang touching each other, at rest. The target is drawn from 0.02 .. 0.12 m.

    What the law changes: how much of ball 1's motion reaches ball 5. With "reversal" (the default; e = 1 is the real
    cradle) ball 5 rises as high as ball 1 was pulled. With "moreau", e = 1, it gets 0.4 of the speed and 0.16 of the
    height. With "maximal-dissipation" all five balls move on together with 1/5 of the speed, rise to 1/25 of the
    height, and it takes several pulls to reach the target.
    """

    SCENE: ClassVar[str] = "newtons_cradle"
    LAW: ClassVar[str] = "reversal"
    FRAME_SKIP: ClassVar[int] = 4
    OBSERVATION: ClassVar = ((5, -2.0, 2.0), (5, -10.0, 10.0), (1, 0.02, 0.12), (1, 0.0, 1.0))
    ACTION: ClassVar = ((1, -1.0, 1.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the string, and a mark at the target."""
        string = spec.add_actuator(name="swing1", target="swing1", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        string.set_to_motor()
        string.gear[0], string.ctrlrange, string.ctrllimited = -PULL, (0.0, 1.0), True
        add_target(spec, 0.125)

    def start(self) -> None:
        """Draw the target, and move the mark to it."""
        self._target = float(self.np_random.uniform(0.02, 0.12))
        self._best = self._gained = self._speed = 0.0
        angle = np.arccos(1.0 - self._target / LENGTH)
        hang = LENGTH * np.array([np.sin(angle), 0.0, -np.cos(angle)])
        self.data.mocap_pos[0] = self.model.body("ball5").pos + hang
        self.data.qvel[:] = 0.0

    def act(self, action: np.ndarray) -> None:
        """Set the pull of the string."""
        self.data.ctrl[:] = action
        self._gained = 0.0

    def watch(self) -> None:
        """Update the best closeness when the last ball passes an apex."""
        before, self._speed = self._speed, float(self.data.qvel[4])
        if before > 0 >= self._speed:
            rise = LENGTH * (1.0 - np.cos(self.data.qpos[4]))
            closeness = max(0.0, 1.0 - abs(rise - self._target) / self._target)
            self._gained += max(0.0, closeness - self._best)
            self._best = max(self._best, closeness)

    def observe(self) -> np.ndarray:
        """Return angles, angular velocities, target and closeness."""
        return np.concatenate([self.data.qpos, self.data.qvel, [self._target, self._best]])

    def judge(self) -> tuple[float, bool]:
        """Reward the increase of the best closeness."""
        return self._gained, self._best >= CLOSE or np.abs(self.data.qpos).max() > np.pi / 2
