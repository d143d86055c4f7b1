"""Restitution that friction leaves in compiled soft steps: scaled to create no energy, none where bodies jam."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import FrictionImpact, Moreau, Stepper
from impactlaw.laws.friction import scaled
from impactlaw.stepping.soft.scheme import SoftStepping

ROD = """<body pos="{x} 0 .8016" euler="0 37 0"><freejoint/>
    <geom type="capsule" size=".005 1" mass="1" friction="{mu}"/></body>"""
SLIDER = """<body pos="9 0 .0999"><joint type="slide" axis="-.866 0 .5"/>
    <geom name="jammed" size=".1" mass="1" friction="1"/></body>"""
SCENES = {
    "gains": ROD.format(x=0, mu=0.7),
    "jams": SLIDER,
    "both and another": ROD.format(x=0, mu=0.7) + ROD.format(x=4, mu=0.0) + SLIDER,
}
"""A rod whose friction would create energy (T. R. Kane), a ball that lands at 30 degrees, and more."""


def scene(name):
    model, data = compiled(
        f'<geom name="floor" type="plane" size="20 9 1" friction="0"/>{SCENES[name]}', option='gravity="0 0 0"'
    )
    for joint in range(model.njnt):
        first = model.jnt_dofadr[joint]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            data.qvel[first : first + 3] = 1.0, 0.0, -1.0
        else:
            data.qvel[first] = -2.0
    return model, data


@pytest.mark.parametrize("e", [0.5, 1.0])
@pytest.mark.parametrize("name", SCENES)
def test_it_is_that_of_python_without_a_step_there(name, e, monkeypatch):
    model, data = scene(name)
    python, other = Stepper(model, Moreau(e), contact_model="soft", compiled="never"), mujoco.MjData(model)
    mujoco.mj_copyData(other, model, data)
    python.step(other)
    told = python.events
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled="auto")
    with monkeypatch.context() as patched:
        patched.setattr(SoftStepping, "step", lambda *_: pytest.fail("it is in Python"))
        stepper.step(data)
    np.testing.assert_allclose(data.qvel, other.qvel, atol=1e-10)
    assert stepper.short_steps == python.short_steps == ("jam" in name or "both" in name)
    np.testing.assert_allclose(stepper.sums[:4], python.sums[:4], rtol=1e-7, atol=1e-9)
    scales = [(event.impact.restitution_scale, known.impact.restitution_scale)
              for event, known in zip(stepper.events, told, strict=True)
              if isinstance(event.impact, FrictionImpact) and isinstance(known.impact, FrictionImpact)]  # fmt: skip
    assert scales
    np.testing.assert_allclose(*np.transpose(scales), atol=1e-9)
    assert all(event.impact.residual < 1e-9 for event in stepper.events)


def test_its_share_is_found_in_few_problems(monkeypatch):
    """Few are needed because the energy is almost quadratic in the share; regula falsi needed 17."""
    shares, choose = [], scaled.next_share

    def counted(*bracket):
        shares.append(choose(*bracket))
        return shares[-1]

    monkeypatch.setattr(scaled, "next_share", counted)
    model, data = scene("gains")
    stepper = Stepper(model, Moreau(1.0), contact_model="soft", compiled="never")
    stepper.step(data)
    (event,) = stepper.events
    assert event.impact.restitution_scale < 0.99
    assert event.impact.energy_change == pytest.approx(0.0, abs=1e-10)
    assert 0 < len(shares) <= 7  # in addition to full restitution and none
