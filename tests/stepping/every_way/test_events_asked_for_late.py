"""Steps find their events by being repeated, with the same model, or not at all, unless they keep collisions."""

import mujoco
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.errors import SceneError

BALL = """<geom name="floor" type="plane" size="9 9 1"/>
    <body pos="0 0 .101"><freejoint/><geom name="ball" size=".1" mass="1"/></body>"""
WAYS = [{"scheme": "time-stepping"}, {"contact_model": "soft"}, {"scheme": "event-driven"}]


def less_friction(model):
    model.geom_friction[:, 0] = 0.01


def no_contact(model):
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def smaller(model):
    model.geom_size[1] = 0.05


def collided(way, code):
    model, data = compiled(BALL)
    data.qvel[:3] = 1, 0, -2
    stepper = Stepper(model, Moreau(0.5), compiled=code, **way)
    while not stepper.sums.collisions:
        stepper.step(data)
    return model, stepper


@pytest.mark.parametrize("change", [less_friction, no_contact, smaller])
@pytest.mark.parametrize("way", WAYS[:2], ids=str)
def test_a_model_that_has_changed_is_an_error(way, change):
    model, stepper = collided(way, "auto")
    energy = stepper.sums.energy_change
    change(model)
    with pytest.raises(SceneError, match="ask for events before the model changes"):
        _ = stepper.events
    assert stepper.sums.energy_change == energy


@pytest.mark.parametrize("change", [less_friction, no_contact, smaller])
@pytest.mark.parametrize(("way", "code"), [(WAYS[0], "never"), (WAYS[1], "never"), (WAYS[2], None)], ids=str)
def test_collisions_that_steps_keep_are_told_all_the_same(way, code, change):
    model, stepper = collided(way, code)
    change(model)
    (event,) = stepper.events
    assert event.impact.energy_change == stepper.sums.energy_change


@pytest.mark.parametrize("way", WAYS[:2], ids=str)
def test_gravity_does_not_matter(way):
    model, stepper = collided(way, "auto")
    model.opt.gravity[2] = 0.0
    (event,) = stepper.events
    assert event.impact.energy_change == pytest.approx(stepper.sums.energy_change, rel=1e-9)
