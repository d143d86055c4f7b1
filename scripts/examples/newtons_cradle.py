"""Newton's cradle: the first of five balls hits the others at 1 m/s. Which balls leave, and how fast?

One sees that only the reversal law hands the speed to the last ball. Moreau's law with e = 1 keeps the energy too, but
throws the first ball back. MuJoCo's own contacts spread the speed over all balls.
"""

import mujoco
import numpy as np

from impactlaw import Fremond, MaximalDissipation, Moreau, Stepper
from impactlaw.models import load

LAWS = {"maximal dissipation": MaximalDissipation(), "Moreau, e = 1": Moreau(1.0), "reversal": Fremond.reversal()}

print(f"{'':20}  velocities of the balls, m/s        energy kept")
for name, law in [*LAWS.items(), ("MuJoCo's contacts", None)]:
    model, data = load("newtons_cradle")
    stepper = None if law is None else Stepper(model, law)
    before = data.qvel @ data.qvel
    for _ in range(8):
        mujoco.mj_step(model, data) if stepper is None else stepper.step(data)
        if stepper is not None and stepper.events:
            break
    shown = "  ".join(f"{v + 0.0:5.2f}" for v in data.qvel.round(9))
    print(f"{name:20} {shown}   {np.sum(data.qvel**2) / before:6.2f}")
