"""An impact law on gymnasium's Hopper, which is dropped from 0.3 m with limp joints under four coefficients e.

One sees that the task changes only when the foot lands: the larger e is, the higher the robot bounces. MuJoCo's own
contacts have no such coefficient.
"""

import gymnasium
import numpy as np

from impactlaw.envs import ImpactLaw


def drop(env: gymnasium.Env) -> tuple[float, int]:
    """Return how high the torso rises after landing, m, and the number of collisions in the first second."""
    env.reset(seed=0)
    base = env.unwrapped
    start = base.init_qpos.copy()  # pyright: ignore[reportAttributeAccessIssue]
    start[1] += 0.3
    base.set_state(start, np.zeros(6))  # pyright: ignore[reportAttributeAccessIssue]
    heights, collisions = [], 0
    for _ in range(125):
        _, _, _, _, info = env.step(np.zeros(3))
        heights.append(base.data.qpos[1])  # pyright: ignore[reportAttributeAccessIssue]
        collisions += info.get("impact/count", 0)
    lowest = int(np.argmin(heights[:60]))
    return max(heights[lowest:]) - heights[lowest], collisions


print("  e   rise, m   collisions")
for e in (0.0, 0.3, 0.6, 0.9):
    env = ImpactLaw(gymnasium.make("Hopper-v5", terminate_when_unhealthy=False), law="moreau", restitution=e)
    print("{:4.1f} {:8.3f} {:10d}".format(e, *drop(env)))
print("MuJoCo{:7.3f}".format(drop(gymnasium.make("Hopper-v5", terminate_when_unhealthy=False))[0]))
