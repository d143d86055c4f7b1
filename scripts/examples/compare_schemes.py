"""A ball with e = 0.5 is dropped from 1 m and stepped in three ways: how high does it bounce, how long takes a step?

One sees that event location is exact at any timestep. Time stepping and the law on top of MuJoCo's soft contact are off
by the distance that the ball moves within a step: at least ten times less at a tenth of the timestep.
"""

import time
from typing import Any

from impactlaw import Moreau, Stepper
from impactlaw.models import load

WAYS: dict[str, dict[str, Any]] = {
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
    "soft": {"contact_model": "soft"},
}
GRAVITY = 9.81

print("way               timestep   rises to, m      error   us a step")
for name, options in WAYS.items():
    for timestep in (1e-2, 1e-3):
        model, data = load("bouncing_ball")
        model.opt.timestep = timestep
        stepper = Stepper(model, Moreau(0.5), **options)
        stepper.step(data)  # loads what is compiled
        start = time.perf_counter()
        while data.time < 0.6:  # it lands at 0.45 s
            stepper.step(data)
        spent = 1e6 * (time.perf_counter() - start) / (data.time / timestep)
        apex = data.qpos[0] + data.qvel[0] ** 2 / (2.0 * GRAVITY)
        print(f"{name:16} {timestep:7.3f} s {apex:12.6f}   {apex - 0.25:+10.1e} {spent:9.0f}")
