"""What is read from MuJoCo's constraint rows while contacts are looked for."""

import mujoco
import numpy as np
import pytest

from impactlaw.scene.contacts import gap_gradients
from impactlaw.scene.detection import Detector

_WORLD = """<geom type="plane" size="1 1 1"/>
    <body pos="0 0 .1"><joint name="a" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>
    <body pos="2 0 1"><joint name="b" type="slide" axis="0 0 1"/><geom size=".1" mass="3"/></body>"""


def _scene(integrator: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return two masses that an equality constraint joins; one of them is on the floor."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option integrator="{integrator}"/><worldbody>{_WORLD}</worldbody>
        <equality><joint joint1="a" joint2="b"/></equality></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    return model, data


def test_constraints_are_as_stiff_under_every_integrator():
    """MuJoCo fills the stiffness of rows late under the integrator "discrete"; before, it is what is in memory."""
    found = {}
    for integrator in ("Euler", "implicit", "discrete"):
        model, data = _scene(integrator)
        data.efc_D[:] = -1.0
        found[integrator] = Detector(model).near(data, 1e-9).stiffness
        assert model.opt.integrator == int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
    assert found["Euler"] == pytest.approx(found["discrete"], rel=1e-12)
    assert found["Euler"] == pytest.approx(found["implicit"], rel=1e-12)
    assert np.linalg.eigvalsh(found["Euler"])[-1] > 1.0


def test_gradients_of_many_contacts_are_those_of_single_ones_and_take_no_jacobian_each(monkeypatch):
    """Robots and boxes, among them limbs of one robot, and the arm of another whose normal meets its only axis."""
    leg = '<joint axis="0 1 0"/><geom type="capsule" size=".05" fromto="0 0 0 .3 0 0"/>'
    legs = "".join(f'<body euler="0 0 {60 * k}">{leg}</body>' for k in range(6))
    box = '<freejoint/><geom type="box" size=".1 .1 .1"/>'
    boxes = "".join(f'<body pos="0 0 {0.2 * k}">{box}</body>' for k in range(4))
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><geom type="plane" size="3 3 1" pos="0 0 -.1"/>
      <body pos="0 1 0"><freejoint/><geom size=".1"/>{legs}</body>{boxes}
      <body pos="2 0 0"><joint axis="0 1 0"/><geom size=".1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos += np.random.default_rng(0).normal(scale=0.01, size=model.nq)
    data.qpos[-1] = 0.3
    mujoco.mj_forward(model, data)
    detector = Detector(model)
    with detector.options:
        contacts = detector.find(data, 0.3)[1]
    assert len(contacts) > 40
    wanted = np.concatenate([gap_gradients(model, data, contacts.select(np.array([i]))) for i in range(len(contacts))])
    calls, jacobian = [], mujoco.mj_jac
    monkeypatch.setattr(mujoco, "mj_jac", lambda *given: (calls.append(given), jacobian(*given)))
    np.testing.assert_allclose(gap_gradients(model, data, contacts), wanted, rtol=0.0, atol=1e-15)
    short = np.abs(wanted).max(axis=1) < 1e-8
    assert not wanted[short].any()
    assert 0 < short.sum() < len(contacts) / 3
    assert len(calls) <= 2 * short.sum()
