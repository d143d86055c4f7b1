"""Features that the options of a scene disable are off, and may be switched between steps."""

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper, read_contacts
from impactlaw.errors import OverlapError
from impactlaw.stepping.plan import make_plan

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
BOX = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".2 .2 .1" mass="1"/></body>'
PENDULUM = """
<body pos="0 0 1"><joint name="hinge" axis="0 1 0" limited="true" range="-10 10"/>
<geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/></body>"""
CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
LIMIT = int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
FREE = -0.5 * 9.81


def fall(stepper, data, seconds=0.5):
    """Step for a while; return the change of the height, or of the angle."""
    before = data.qpos.copy()
    for _ in range(round(seconds / stepper.model.opt.timestep)):
        stepper.step(data)
    return (data.qpos - before)[min(2, len(before) - 1)]


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
@pytest.mark.parametrize("flag", [CONTACT, CONSTRAINT])
def test_what_falls_passes_through_where_contact_is_disabled(flag, contact_model):
    model, data = compiled(FLOOR + BOX, option='integrator="RK4"')
    model.opt.disableflags |= flag
    stepper = Stepper(model, Moreau(0.5), contact_model=contact_model)
    assert fall(stepper, data) == pytest.approx(FREE * 0.25, rel=1e-9)
    assert len(read_contacts(model, data).gap) == 0
    assert model.opt.disableflags & flag
    part = stepper.plan.parts[0]
    assert (part.name, part.runs) == ("collision detection", False)
    assert "disable" in part.why


def test_the_plan_of_a_scene_with_contact_says_so():
    model, _ = compiled(FLOOR + BOX)
    assert make_plan(model, "rigid").parts[0].runs


@pytest.mark.parametrize("friction", [True, False])
def test_contact_switched_off_lets_a_box_at_rest_fall(friction):
    model, data = compiled(FLOOR + BOX, option='integrator="RK4"')
    stepper = Stepper(model, Moreau(0.0), friction="coulomb" if friction else "ignore")
    assert fall(stepper, data) == pytest.approx(0.0, abs=1e-10)
    model.opt.disableflags |= CONTACT
    assert fall(stepper, data, 0.02) == pytest.approx(FREE * 0.02**2, rel=1e-9)


def test_contact_switched_on_again_catches_what_is_above_and_refuses_what_is_inside():
    model, data = compiled(FLOOR + BOX.replace("0 0 .1", "0 0 .2"), option='integrator="RK4"')
    model.opt.disableflags |= CONTACT
    stepper = Stepper(model, Moreau(0.0))
    fall(stepper, data, 0.1)
    model.opt.disableflags &= ~CONTACT
    fall(stepper, data, 0.5)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)
    model.opt.disableflags |= CONTACT
    fall(stepper, data, 0.1)
    model.opt.disableflags &= ~CONTACT
    with pytest.raises(OverlapError, match="box"):
        stepper.step(data)


@pytest.mark.parametrize("flag", [LIMIT, CONSTRAINT])
def test_limits_that_are_disabled_let_a_joint_through(flag):
    model, data = compiled(PENDULUM, option='integrator="RK4" timestep="0.001"')
    stepper = Stepper(model, Moreau(0.0))
    fall(stepper, data)
    assert data.qpos[0] == pytest.approx(np.radians(10), abs=1e-9)
    model.opt.disableflags |= flag
    fall(stepper, data)
    assert data.qpos[0] > np.radians(30)
