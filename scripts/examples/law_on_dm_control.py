"""An impact law on a task of dm_control: the ball in the cup, with the same controls under three coefficients e.

One sees how often and how hard the ball hits the cup, and that the law alone leads to three different motions.
"""

import numpy as np
from dm_control import suite

from impactlaw.envs import put_law

print("  e   collisions   hardest, m/s   lost, mJ   ball after 2 s, m")
for e in (0.0, 0.5, 0.9):
    env = suite.load("ball_in_cup", "catch", task_kwargs={"random": 1})
    law = put_law(env, "moreau", e)
    env.reset()
    impacts = []
    for i in range(100):
        time = env.control_timestep() * i
        env.step(np.array([0.4 * np.sin(5.0 * time), 0.8 * np.cos(7.0 * time)]))
        impacts += [event.impact for event in law.events]
    hardest = max(-impact.collision.pre_contact_velocity.min() for impact in impacts)
    lost = -1e3 * sum(impact.energy_change for impact in impacts)
    x, z = env.physics.named.data.qpos[["ball_x", "ball_z"]]
    print(f"{e:4.1f} {len(impacts):11d} {hardest:13.2f} {lost:12.1f}        ({x:5.2f}, {z:5.2f})")
