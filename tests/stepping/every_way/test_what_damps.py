"""Joint damping acts in the same way however it is written: in joints, motors, servos or tendons."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_WAYS = {
    "event-driven": {},
    "time stepping": {"scheme": "time-stepping"},
}


def _scene(damping: float, by: str, integrator: str) -> mujoco.MjModel:
    """Return two light links with damped hinges, onto which a ball and a box of 1 kg fall."""
    rest = {
        "joint": "",
        "motor": '<actuator><motor joint="a" damping="{0}"/><motor joint="b" damping="{0}"/></actuator>',
        "servo": '<actuator><velocity joint="a" kv="{0}"/><velocity joint="b" kv="{0}"/></actuator>',
        "tendon": '<tendon><fixed damping="{0}"><joint joint="a" coef="1"/></fixed>'
        '<fixed damping="{0}"><joint joint="b" coef="1"/></fixed></tendon>',
    }[by].format(damping)
    joint = f'axis="0 1 0" damping="{damping if by == "joint" else 0.0}"'
    link = '<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".02"/>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option integrator="{integrator}"><flag energy="enable"/></option><worldbody>
        <geom type="plane" size="9 9 1"/>
        <body pos="0 0 .3"><joint name="a" {joint}/>{link}
          <body pos=".3 0 0"><joint name="b" {joint}/>{link}</body></body>
        <body pos=".25 0 .7"><freejoint/><geom size=".05" mass="1"/></body>
        <body pos=".5 0.01 .9"><freejoint/><geom type="box" size=".05 .04 .05" mass="1"/></body></worldbody>
        {rest}</mujoco>"""
    )


def _run(damping: float, by: str, way: str, integrator: str) -> tuple[np.ndarray, float]:
    """Return the positions after 1 s, and the largest energy as a multiple of the initial one."""
    model = _scene(damping, by, integrator)
    stepper, data, energy = Stepper(model, Moreau(0.5), **_WAYS[way]), mujoco.MjData(model), []
    for _ in range(500):
        stepper.step(data)
        mujoco.mj_forward(model, data)
        energy.append(data.energy.sum())
    return data.qpos.copy(), max(energy) / energy[0]


@pytest.mark.parametrize("integrator", ["implicitfast", "implicit"])
@pytest.mark.parametrize("way", _WAYS)
@pytest.mark.parametrize("by", ["motor", "servo", "tendon"])
def test_what_damps_a_joint_is_one(by: str, way: str, integrator: str) -> None:
    expected, most = _run(5.0, "joint", way, integrator)
    found, gained = _run(5.0, by, way, integrator)
    assert max(most, gained) < 1.001
    np.testing.assert_allclose(found, expected, atol=1e-6)
