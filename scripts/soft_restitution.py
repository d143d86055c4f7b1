"""What soft stepping makes of a coefficient of restitution: a contact is seen a timestep after it has closed.

A ball falls from several heights; the effective coefficient is the root of the ratio of the next height to this one.
Contacts that are tuned to bounce by themselves, as those of a table tennis task, add nothing to what the law decides.
"""

import mujoco
import numpy as np
import tyro

from impactlaw import Moreau, Stepper

E = 0.5
HEIGHTS = 0.3, 1.2
"""Least and largest height of the fall, m."""
SPRINGS = {"damping ratio 1": "0.02 1", "damping ratio 0.03": "0.1 0.03"}
"""solref of contacts: MuJoCo's default, and that of fancy_gym's table tennis."""
_SCENE = """<mujoco><option timestep="0.002" integrator="{}"/><default><geom solref="{}"/></default>
  <worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody></mujoco>"""


def effective(integrator: str, solref: str, height: float) -> float:
    """Return the coefficient with which a ball that falls from a height, m, has bounced."""
    model = mujoco.MjModel.from_xml_string(_SCENE.format(integrator, solref))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(E), contact_model="soft")
    data.qpos[0] = height
    highest, bounced = 0.0, False
    while not bounced or data.qvel[0] > 0.0:
        stepper.step(data)
        bounced = bounced or len(stepper.events) > 0
        highest = max(highest, data.qpos[0]) if bounced else 0.0
    return float(np.sqrt(highest / height))


def main() -> None:
    """Print the least and the largest effective coefficient under each integrator, with each solref."""
    for name, solref in SPRINGS.items():
        for integrator in ("Euler", "RK4", "implicitfast"):
            found = [effective(integrator, solref, height) for height in np.linspace(*HEIGHTS, 91)]
            reached = f"{min(found):.3f} to {max(found):.3f}"
            print(f"{name}, {integrator}, 2 ms, e = {E}: falls of {HEIGHTS} m bounce with {reached}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
