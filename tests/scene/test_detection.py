"""What is read from MuJoCo's constraint rows while contacts are looked for."""

import mujoco
import numpy as np
import pytest

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
