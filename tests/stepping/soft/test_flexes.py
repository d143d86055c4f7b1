"""Contacts of flexes are MuJoCo's; the law acts on contacts of geoms beside them."""

import warnings

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.errors import FlexContactsWarning

_SCENE = """<mujoco><option timestep=".001" cone="{cone}"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <flexcomp type="grid" count="5 5 1" spacing=".08 .08 .08" dim="2" radius=".01" mass=".2" name="cloth" pos="0 0 .1">
    <edge equality="true"/><contact selfcollide="none"/></flexcomp>
  <body pos="3 0 .2"><freejoint/><geom name="ball" size=".06" mass=".3"/></body></worldbody></mujoco>"""


_LEFT = pytest.mark.filterwarnings("ignore::impactlaw.errors.FlexContactsWarning")


@_LEFT
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("contacts", [None, "ball/floor"])
def test_ball_bounces_beside_a_cloth_that_falls_and_rests(contacts: str | None, cone: str) -> None:
    model = mujoco.MjModel.from_xml_string(_SCENE.format(cone=cone))
    stepper, data = Stepper(model, Moreau(0.5), contact_model="soft", contacts=contacts), mujoco.MjData(model)
    collisions = []
    for _ in range(400):
        stepper.step(data)
        collisions += stepper.events
    assert [event.contacts.labels for event in collisions] == [("floor/ball",)] * 2
    for event in collisions:
        impact = event.impact
        assert impact.post_contact_velocity == pytest.approx(-0.5 * impact.collision.pre_contact_velocity, rel=1e-9)
    assert (data.flexvert_xpos[:, 2] < 0.02).all()


@_LEFT
def test_a_flex_that_lands_alone_is_left_to_mujoco() -> None:
    """There is no contact of geoms yet, only of the cloth."""
    edges = '<edge equality="true"/>'
    model = mujoco.MjModel.from_xml_string(_SCENE.format(cone="pyramidal").replace(edges, '<edge damping=".01"/>'))
    model.opt.gravity[2] = -30.0
    stepper, data, plain = Stepper(model, Moreau(0.5), contact_model="soft"), mujoco.MjData(model), mujoco.MjData(model)
    for _ in range(90):
        stepper.step(data)
        mujoco.mj_step(model, plain)
        assert not stepper.events
    assert data.ncon > 0
    np.testing.assert_array_equal(data.qpos, plain.qpos)


@pytest.mark.parametrize(
    ("contact", "told"),
    [
        ('selfcollide="none"', 1),
        ('selfcollide="none" contype="2" conaffinity="2"', 0),
        ('selfcollide="auto" contype="2" conaffinity="2"', 1),
        ('selfcollide="none" contype="0" conaffinity="0"', 0),
    ],
)
def test_contacts_of_flexes_are_told(contact: str, told: int) -> None:
    model = mujoco.MjModel.from_xml_string(_SCENE.format(cone="elliptic").replace('selfcollide="none"', contact))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        Stepper(model, Moreau(0.5), contact_model="soft")
        Stepper(model, Moreau(0.5), contact_model="soft", contacts="ball/floor")
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        Stepper(model, Moreau(0.5), contact_model="soft")
    found = [warning for warning in found if warning.category is FlexContactsWarning]
    assert [warning.filename for warning in found] == [__file__] * told
