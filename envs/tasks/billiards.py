"""Billiards: aim the cue ball at the rack and break it."""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from impactlaw.envs.base import ImpactEnv

BALLS = 16
"""The cue ball and fifteen others."""
DURATION = 1.5
"""Duration of a shot, s."""
WIDEST_AIM = 0.35
"""Largest angle of the shot to the table's long axis, rad."""
SPEED = (1.0, 4.0)
"""Least and largest speed of the cue ball, m/s."""
POCKETS = tuple((x, y, 0.07 if x == 0 else 0.1) for x in (-1.25, 0.0, 1.25) for y in (-0.625, 0.625))
"""Positions x, y on the cushions' edge and radius of each pocket, m."""
TRAY = -0.9
"""The y coordinate of the row of potted balls, outside the long side of the table, m."""
_CENTERS, _RADII_SQUARED = np.array(POCKETS).T[:2, :, None], np.array(POCKETS)[:, 2:] ** 2


class Billiards(ImpactEnv):
    r"""Aim the cue ball at fifteen racked balls, once, and pot as many of them as possible in 1.5 s.

    The balls slide without friction and do not roll. A ball whose center comes within a pocket's radius (0.1 m in the
    corners, 0.07 m at the sides) is potted and lies beside the table from then on.

    Observation, `Box(81)`:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0-31 | x and y of the cue ball, of ball 1, .. of ball 15; x along the table, towards the rack | m | -2 .. 2 |
    | 32-63 | their velocities in x and y | m/s | -4 .. 4 |
    | 64-79 | whether they are potted | 1 | 0 .. 1 |
    | 80 | time left | s | 0 .. 1.5 |

    Action, `Box(2)`, which makes the shot in the first step of an episode and has no effect afterwards:

    | index | meaning | unit | range |
    |---|---|---|---|
    | 0 | angle of the shot to the x axis, as a fraction of 0.35 rad, positive towards positive y | 1 | -1 .. 1 |
    | 1 | speed of the cue ball: -1 is 1 m/s, 1 is 4 m/s | 1 | -1 .. 1 |

    Reward: 1 for every potted ball, -1 for the cue ball.

    End: terminated after 1.5 s (30 steps).

    Start: the racked balls touch; the cue ball lies 1.2 m in front of them, up to 0.2 m to either side.

    What the law changes: where the balls go after the break, a collision with 31 contacts. Under Moreau's law each
    racked ball leaves with ``(1 + e) p``, where p is its velocity under maximal dissipation, so e changes the speed of
    a ball but not its direction. After a full hit, three balls on either side move in a row towards a corner. With
    e = 0.95 (the default) four of the six arrive in time, with e = 0 none; "reversal" sends other balls in other
    directions. Later collisions are chaotic.
    """

    SCENE: ClassVar[str] = "billiard_rack"
    LAW: ClassVar[str] = "moreau"
    FRAME_SKIP: ClassVar[int] = 5
    OBSERVATION: ClassVar = ((2 * BALLS, -2.0, 2.0), (2 * BALLS, -4.0, 4.0), (BALLS, 0.0, 1.0), (1, 0.0, DURATION))
    ACTION: ClassVar = ((2, -1.0, 1.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the pockets, and set the timestep to 10 ms: it is exact, as balls move straight between collisions."""
        spec.option.timestep = 0.01
        for i, (x, y, radius) in enumerate(POCKETS):
            pocket = spec.worldbody.add_geom(
                name=f"pocket{i + 1}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[x, y, -0.03], size=[radius, 0.001, 0.0]
            )
            pocket.rgba = [0.05, 0.05, 0.05, 1.0]
            pocket.contype = pocket.conaffinity = 0

    def start(self) -> None:
        """Draw the position of the cue ball."""
        self._origin = self.model.body_pos[1:, :2].copy()
        self._potted = np.zeros(BALLS, dtype=bool)
        self._gained = 0.0
        self.data.qvel[:] = 0.0
        self.data.joint("cue_y").qpos = self.np_random.uniform(-0.2, 0.2)

    def act(self, action: np.ndarray) -> None:
        """Shoot, in the first step of an episode."""
        self._gained = 0.0
        if self.data.time == 0.0:
            angle = WIDEST_AIM * action[0]
            speed = SPEED[0] + (SPEED[1] - SPEED[0]) * 0.5 * (1.0 + action[1])
            self.data.qvel[:2] = speed * np.cos(angle), speed * np.sin(angle)

    def watch(self) -> None:
        """Take potted balls off the table."""
        away = self._positions().T[:, None] - _CENTERS
        away *= away
        inside = away[0] + away[1] < _RADII_SQUARED
        if not np.count_nonzero(inside):
            return
        fallen = inside.any(axis=0) & ~self._potted
        self._potted |= fallen
        self._gained += np.count_nonzero(fallen[1:]) - float(fallen[0])
        for ball in np.flatnonzero(fallen):
            place = np.array([0.075 * (ball - 7.5), TRAY])
            self.data.qpos[2 * ball : 2 * ball + 2] = place - self._origin[ball]
            self.data.qvel[2 * ball : 2 * ball + 2] = 0.0

    def observe(self) -> np.ndarray:
        """Return positions, velocities, which balls are potted, and the time left."""
        left = DURATION - self.data.time
        return np.concatenate([self._positions().ravel(), self.data.qvel, self._potted, [left]])

    def judge(self) -> tuple[float, bool]:
        """Reward the balls potted in this step."""
        return self._gained, self.data.time >= DURATION - 1e-9

    def _positions(self) -> np.ndarray:
        return self._origin + self.data.qpos.reshape(-1, 2)
