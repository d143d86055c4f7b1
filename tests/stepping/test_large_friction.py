"""Friction that prevents all sliding, and friction that is larger than rigid steps can resolve."""

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Batch, Moreau, Stepper
from impactlaw.errors import DivergenceError, SceneError, WorldsFailedError

WAYS = [{}, {"scheme": "time-stepping"}]


def box_above(mu, condim=3):
    """Return a box 1 cm above a floor."""
    floor = f'<geom name="floor" type="plane" size="1 1 1" friction="{mu}" condim="1"/>'
    box = f'<freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1" condim="{condim}"/>'
    return compiled(f'{floor}<body pos="0 0 .11">{box}</body>', option='integrator="RK4"')


@pytest.mark.parametrize("options", WAYS)
def test_a_box_sticks_where_it_lands_by_the_largest_friction(options):
    model, data = box_above(1e4)
    data.qvel[0] = 0.2  # slower than its fall, so that it does not tip
    stepper = Stepper(model, Moreau(0), **options)
    for _ in range(50):
        stepper.step(data)
    np.testing.assert_allclose(data.qvel, 0.0, atol=1e-8)
    assert data.qpos[0] == pytest.approx(0.2 * np.sqrt(2 * 0.01 / 9.81), abs=4e-4)  # m; up to a timestep early


@pytest.mark.parametrize("options", WAYS)
@pytest.mark.parametrize("mu", [1e5, 1e8, 1e12])
def test_more_is_refused(mu, options):
    """Regression: time stepping let a box slide a tenth too far with 1e5, and freely with 1e8, without counting it."""
    with pytest.raises(SceneError, match=r"friction up to 10000, got .* of floor/box"):
        Stepper(box_above(mu)[0], Moreau(0), **options)


@pytest.mark.parametrize("options", [*WAYS, {"contact_model": "soft"}])
def test_what_is_no_number_is_refused(options):
    """Regression: rigid steps took a coefficient of NaN for no friction."""
    model, _ = box_above(1)
    model.geom("floor").friction[0] = np.nan
    with pytest.raises(SceneError, match="geom_friction has entries that are not finite"):
        Stepper(model, Moreau(0), **options)


def test_more_is_refused_in_batches_and_allowed_where_it_is_not_used():
    with pytest.raises(SceneError, match="friction up to 10000"):
        Batch(box_above(1e8)[0], Moreau(0), 2)
    Stepper(box_above(1e8, condim=1)[0], Moreau(0))
    Stepper(box_above(1e8)[0], Moreau(0), friction="ignore")
    Stepper(box_above(1e8)[0], Moreau(0), contact_model="soft")


@pytest.mark.parametrize("friction", ["1 1e8 1e-4", "1 .1 1e6"])
@pytest.mark.parametrize("options", WAYS)
def test_torsion_and_rolling_that_are_too_large_are_refused(friction, options):
    """Regression: a ball kept all or some of its 10 rad/s about the normal as it landed, and no step was counted."""
    floor = f'<geom name="floor" type="plane" size="1 1 1" friction="{friction}" condim="6"/>'
    model, _ = compiled(floor + '<body pos="0 0 .2"><freejoint/><geom name="ball" size=".1"/></body>')
    with pytest.raises(SceneError, match=r"friction up to 10000, got .* of floor/ball"):
        Stepper(model, Moreau(0.5), **options)


@pytest.mark.parametrize("options", WAYS)
def test_friction_that_becomes_no_number_ends_the_steps(options):
    """Regression: a box slid as on ice."""
    model, data = box_above(1)
    data.qpos[2] = 0.1
    stepper = Stepper(model, Moreau(0), **options)
    stepper.step(data)
    model.geom_friction[:] = np.nan
    with pytest.raises((SceneError, DivergenceError), match="not finite"):
        stepper.step(data)


def test_friction_that_becomes_no_number_in_one_world():
    model, _ = box_above(1)
    batch = Batch(model, Moreau(0), 2)
    batch.bind("qpos")[:, 2] = 0.1
    batch.expand("geom_friction")[1] = np.nan
    with pytest.raises(WorldsFailedError, match="not finite") as caught:
        batch.step()
    assert list(caught.value.worlds) == [1]


def test_friction_that_becomes_too_large_ends_event_driven_steps():
    model, data = box_above(1)
    stepper = Stepper(model, Moreau(0))
    stepper.step(data)
    model.geom("floor").friction[0] = 1e7
    with pytest.raises(SceneError, match="friction up to 10000"):
        stepper.step(data)
