"""Vehicles whose wheels touch the ground along lines: friction of many points on few bodies is found."""

import mujoco
import numpy as np
from scenes import compiled

from impactlaw import Moreau, Stepper

FRONT = """<body pos=".165 {side} 0"><inertial pos="0 0 0" mass=".1" diaginertia="4e-6 4e-6 4e-6"/>
  <joint name="{name}" axis="0 0 1" range="-45 45"/><body>
  <inertial pos="0 {middle} 0" mass=".34" diaginertia="2.6e-4 4.1e-4 2.6e-4"/><joint axis="0 1 0"/>
  <geom type="cylinder" size=".05 .0225" pos="0 {middle} 0" quat=".707105 .707108 0 0"/></body></body>"""
CAR = f"""<mujoco><compiler autolimits="true"/><option timestep="0.004"/>
  <default><geom condim="6"/><joint damping=".001"/></default><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 .05"><freejoint/><inertial pos=".03 0 0" mass=".54" diaginertia=".2 .21 .36"/>
  {FRONT.format(name="left", side=0.1, middle=0.0225)}{FRONT.format(name="right", side=-0.1, middle=-0.0225)}
  <body pos="-.16 0 0"><inertial pos="0 0 0" mass=".79" diaginertia=".05 .1 .06"/><joint name="axle" axis="0 1 0"/>
  <geom type="cylinder" size=".05 .0225" pos="0 .1225 0" quat=".707105 .707108 0 0"/>
  <geom type="cylinder" size=".05 .0225" pos="0 -.1225 0" quat=".707105 .707108 0 0"/></body></body></worldbody>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator><velocity joint="axle" kv="1" forcerange="-1 1" ctrlrange="-20 20"/>
  <position joint="left" kp="1" forcerange="-1 1" ctrlrange="-.785 .785"/></actuator></mujoco>"""


def test_friction_of_four_wheels_on_lines_is_found():
    """Regression: 37 of 1500 steps ended near a solution, with half of the work left; quaternions have six digits."""
    model, short = mujoco.MjModel.from_xml_string(CAR), 0
    for seed in range(6):
        data, random = mujoco.MjData(model), np.random.default_rng(seed)
        stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
        for step in range(250):
            if step % 10 == 0:
                data.ctrl[:] = random.uniform(*model.actuator_ctrlrange.T)
            stepper.step(data)
        short += stepper.short_steps
    assert short <= 15


def test_symmetric_cars_load_both_sides_alike():
    """Regression: rounded gaps and speeds shifted up to 11 N from wheel to wheel in 1 s, until one wheel spun."""
    torque, r, axles, wheel, body, height = 2.0, 0.1, 0.3, 0.4, 4.0, 0.15
    ball, mass = 0.4 * wheel * r**2, body + 4 * wheel
    wheels = "".join(
        f'<body pos="{x} {y} 0"><joint axis="0 1 0"/><geom size="{r}" mass="{wheel}"/></body>'
        for x in (axles, -axles)
        for y in (0.2, -0.2)
    )
    car = f'<inertial pos="0 0 {height}" mass="{body}" diaginertia=".05 .1 .1"/>{wheels}'
    world = f'<geom type="plane" size="9 9 1"/><body pos="0 0 {r}"><freejoint/>{car}</body>'
    model, data = compiled(world, option='timestep="0.001" cone="elliptic"', geom='friction="0.6"')
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    data.qfrc_applied[-2:] = torque / 2
    for _ in range(1000):
        stepper.step(data)
    a = torque / r / (mass + 4 * ball / r**2)
    shift = ((body * (r + height) + 4 * wheel * r) * a + 4 * ball * a / r) / (4 * axles)
    loads = [data.efc_force[contact.efc_address] for contact in data.contact]
    front, rear = mass * 9.81 / 4 - shift, mass * 9.81 / 4 + shift
    np.testing.assert_allclose(loads, [front, front, rear, rear], atol=1e-3)
    np.testing.assert_allclose(data.qvel, [a, *[0.0] * 5, *[a / r] * 4], atol=1e-9)
