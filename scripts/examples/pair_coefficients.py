"""One coefficient of restitution per pair of geoms, stored in the MJCF itself.

One sees three balls that fall 1 m onto one floor and rise to e^2 of that, each with the coefficient of its own pair
with the floor: wood has the default of the scene, rubber and clay have coefficients of their own.
"""

import mujoco

from impactlaw import Stepper

BALL = '<body pos="{x} 0 1.1"><joint type="slide" axis="0 0 1"/><geom name="{name}" size=".1" condim="1"/></body>'
SCENE = f"""<mujoco><option timestep=".002" integrator="RK4"/>
<custom>
  <numeric name="restitution" data="0.5"/>
  <numeric name="restitution/rubber/floor" data="0.9"/>
  <numeric name="restitution/clay/floor" data="0"/>
</custom>
<worldbody><geom name="floor" type="plane" size="2 2 1" condim="1"/>
{BALL.format(x=-0.5, name="wood")}{BALL.format(x=0, name="rubber")}{BALL.format(x=0.5, name="clay")}
</worldbody></mujoco>"""

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
stepper = Stepper(model, "scene")
highest = {"wood": 0.0, "rubber": 0.0, "clay": 0.0}
landed = False
while data.time < 1.0:
    stepper.step(data)
    landed = landed or bool(stepper.events)
    for i, name in enumerate(highest):
        if landed:
            highest[name] = max(highest[name], 1.0 + data.qpos[i])
for name, e in (("wood", 0.5), ("rubber", 0.9), ("clay", 0.0)):
    print(f"{name:7} e = {e:.1f}: rises to {highest[name]:.4f} m, e^2 = {e * e:.4f}")
