"""Contacts that bodies cannot close in a step get no rows; forces and collisions that close one bring it back."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper


def test_boxes_that_fall_together_have_no_rows():
    """Regression: 27 boxes 2 mm apart that fall at 10 m/s had 972 rows, since each moves by 2 cm in a step."""
    places = 0.022 * np.stack(np.meshgrid(*[range(3)] * 3), -1).reshape(-1, 3) + [0, 0, 20]
    boxes = "".join(
        f'<body pos="{x} {y} {z}"><freejoint/><geom type="box" size=".01 .01 .01"/></body>' for x, y, z in places
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="9 9 1"/>{boxes}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[2::6] = -10.0
    stepper, most = Stepper(model, Moreau(0.5), scheme="time-stepping"), 0
    for _ in range(50):
        stepper.step(data)
        most = max(most, data.nefc)
    assert most == 0
    assert data.qvel[2::6] == pytest.approx(-10.0 - 0.1 * 9.81)


def test_a_force_that_is_switched_on_closes_contacts_left_out():
    """Bodies at rest are .12 mm apart, farther than gravity moves one of them in a step."""
    number, gap, force = 20, 1.2e-4, 200.0
    ball = '<joint name="{}{}" type="slide" axis="1 0 0"/><geom size=".01" mass="1"/>'
    balls = "".join(
        f'<body pos="0 {0.1 * i} 0">{ball.format("a", i)}</body>'
        f'<body pos="{0.02 + gap} {0.1 * i} 0">{ball.format("b", i)}</body>'
        for i in range(number)
    )
    motors = "".join(f'<motor joint="a{i}"/><motor joint="b{i}" gear="-1"/>' for i in range(number))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{balls}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.ctrl[:] = force
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(3):
        stepper.step(data)
    assert stepper.short_steps == 0
    assert data.qpos == pytest.approx(np.tile([0.5 * gap, -0.5 * gap], number), abs=1e-9)
    assert data.qfrc_constraint == pytest.approx(np.tile([-force, force], number))


@pytest.mark.parametrize("gap", [5e-4, 1e-3, 5e-3])
def test_rows_of_balls_that_move_together_come_back_from_a_wall(gap):
    """No two balls approach each other before the first one meets the wall; equal balls then exchange velocities."""
    rows, number = 6, 3
    balls = "".join(
        f'<body pos="{0.02 + 1e-3 * row + (0.02 + gap) * i:.6f} {0.1 * row} 0">'
        '<joint type="slide" axis="1 0 0"/><geom size=".01" mass="1"/></body>'
        for row in range(rows)
        for i in range(number)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody>
        <geom type="plane" size="1 1 1" zaxis="1 0 0"/>{balls}</worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = -1.0
    stepper, least = Stepper(model, Moreau(1.0), scheme="time-stepping"), 1.0
    for _ in range(40):
        stepper.step(data)
        least = min(least, gap + np.diff(data.qpos.reshape(rows, number)).min())
    assert least > -1e-5
    assert data.qvel == pytest.approx(1.0, abs=1e-9)
    assert stepper.short_steps == 0
