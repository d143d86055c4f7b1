"""Measure the effective restitution of soft steps, which see a contact up to a timestep after it has closed.

A ball falls from several heights. The effective coefficient is the square root of the height of the rebound over the
height of the fall. Contacts tuned to bounce by themselves, such as those of a table tennis task, add no speed to the
rebound that the law asks for.
"""

import mujoco
import numpy as np
import tyro

from impactlaw import Moreau, Stepper

E = 0.5
HEIGHTS = 0.3, 1.2
"""Smallest and largest height of fall, m."""
SPRINGS = {"damping ratio 1": "0.02 1", "damping ratio 0.03": "0.1 0.03"}
"""`solref` of contacts: MuJoCo's default, and the one of fancy_gym's table tennis."""
_SCENE = """<mujoco><option timestep="0.002" integrator="{}"/><default><geom solref="{}"/></default>
  <worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody></mujoco>"""


def effective(integrator: str, solref: str, height: float) -> float:
    """Return the effective coefficient of the first rebound of a ball that falls from a height, m."""
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
    """Print the smallest and the largest effective coefficient for each `solref` and integrator."""
    for name, solref in SPRINGS.items():
        for integrator in ("Euler", "RK4", "implicitfast"):
            found = [effective(integrator, solref, height) for height in np.linspace(*HEIGHTS, 91)]
            reached = f"{min(found):.3f} to {max(found):.3f}"
            print(f"{name}, {integrator}, 2 ms, e = {E}: falls of {HEIGHTS} m bounce with {reached}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
