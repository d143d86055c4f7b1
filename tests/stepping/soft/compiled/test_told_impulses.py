"""Impulses that compiled soft steps tell for events are those of Python: contact by contact, row by row."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.soft.compiled.test_known_outcomes import packed

from impactlaw import Coulomb, FrictionImpact, Moreau, Stepper
from impactlaw.mechanics.friction_impact import cone_gradients

BODIES = """<geom type="plane" size="5 5 .1"/>
  <body pos="0 0 .3" euler="20 30 0"><freejoint/><geom type="ellipsoid" size=".1 .15 .05"/></body>
  <body pos=".05 0 .5"><freejoint/><geom size=".08" condim="1"/></body>
  <body pos="-.5 0 .3"><joint axis="0 1 0" range="-20 30"/><geom type="capsule" fromto="0 0 0 -.3 0 0" size=".03"/>
    <body pos="-.3 0 0"><joint axis="0 1 0" range="-10 10"/><geom type="capsule" fromto="0 0 0 -.2 0 0" size=".03"/>
  </body></body>"""
"""No contacts are redundant, so that impulses are unique; geoms that touch others are not in the order of limits."""

COMPARED = {
    "impulse": 1e-8,
    "friction_impulse": 1e-8,
    "target_contact_velocity": 1e-10,
    "target_sliding_velocity": 1e-10,
}
"""Accuracy of attributes of impacts, for impulses relative to the largest one."""


def made(impact):
    """Return the velocity jump that the impulses of an impact make, whitened."""
    if isinstance(impact, FrictionImpact):
        return impact.cone_impulse @ cone_gradients(impact.collision)
    return impact.impulse @ impact.collision.whitened_jacobian


def missed(impact):
    """Return how far impulses miss the velocity jump, relative to the speed."""
    return np.linalg.norm(impact.whitened_jump - made(impact)) / impact.collision.pre_speed


@pytest.mark.parametrize("cone", ["exact", "convex"])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
@pytest.mark.parametrize("option", ['cone="pyramidal"', 'cone="elliptic" integrator="RK4" jacobian="sparse"'])
def test_they_are_those_of_python(condim, option, cone):
    model, data = compiled(BODIES, option=option, geom=f'condim="{condim}" friction=".8 .02 .01"')
    law = Coulomb(Moreau(0.5), cone=cone, tangential_restitution=0.3)
    ours = Stepper(model, law, contact_model="soft", compiled="auto")
    python, other, told = Stepper(model, law, contact_model="soft", compiled="never"), mujoco.MjData(model), 0
    for _ in range(500):
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        for event, known in zip(ours.events, python.events, strict=True):
            assert event.contacts.labels == known.contacts.labels
            assert event.time == known.time
            np.testing.assert_allclose(event.qpos, known.qpos, atol=1e-12)
            one, another = event.impact, known.impact
            assert type(one) is type(another)
            assert getattr(one, "exact", None) == getattr(another, "exact", None)
            for name, accuracy in COMPARED.items():
                if hasattr(another, name):
                    size = np.abs(another.impulse).max() if "impulse" in name else 1.0
                    np.testing.assert_allclose(getattr(one, name), getattr(another, name), atol=accuracy * size)
            assert missed(one) < 1e-11
            told += len(event.contacts)
    assert told > 10


def test_they_make_the_velocity_jump_where_contacts_are_redundant():
    """Impulses that are fitted to the outcome miss it by up to 2e-9."""
    model, data = packed(6, 3)
    stepper, worst = Stepper(model, Moreau(0.5), contact_model="soft"), 0.0
    for _ in range(145):
        stepper.step(data)
        worst = max([worst, *(missed(event.impact) for event in stepper.events)])
    assert 0.0 < worst < 1e-12
