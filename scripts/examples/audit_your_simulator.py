"""Audit what your own simulator makes of a collision: is it possible at all, and if not, what is wrong with it?

One sees the set S of possible outcomes judge. Three balls touch, and the first one is launched. The outcomes are those
of MuJoCo's contacts, of sequential impulses stopped after two sweeps, one that pulls, and one with a sign error.
"""

import mujoco
import numpy as np

from impactlaw import Collision, Impact
from impactlaw.models import load

model, data = load("ball_chain")
collision = Collision.from_mujoco(model, data)
for _ in range(20):
    mujoco.mj_step(model, data)

swept = collision.pre_velocity.copy()
for _ in range(2):
    for row in collision.jacobian:  # equal balls of 1 kg exchange their closing velocities, pair by pair
        swept -= min(0.0, row @ swept) * row
outcomes = {
    "MuJoCo": data.qvel,
    "pairwise sweeps": swept,
    "pulls": [0.5, 0.6, -0.1],
    "wrong sign": -collision.pre_velocity,
}
for name, velocity in outcomes.items():
    impact = Impact.observed(collision, velocity)
    shown = np.array2string(np.asarray(velocity), precision=3, floatmode="fixed", suppress_small=True)
    v = impact.violations
    verdict = "possible"
    if not v.is_admissible(1e-6):
        verdict = f"impossible: penetrates {v.kinematic:.2f}, pulls {v.kinetic:.2f}, gains energy {v.energetic:.2f}"
    print(f"{name:16} v+ = {shown}  T+/T- = {1 + impact.energy_change / collision.kinetic_energy:.3f}  {verdict}")
print(f"nearest possible to the wrong sign: {collision.admissible_set.project(-collision.pre_velocity).round(3)}")
