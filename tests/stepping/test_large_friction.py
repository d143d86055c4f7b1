"""Friction that keeps everything from sliding, and more than rigid steps can resolve."""

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Batch, Moreau, Stepper
from impactlaw.errors import SceneError

WAYS = [{}, {"scheme": "time-stepping"}, {"scheme": "time-stepping", "compiled": "never"}]


def box_above(mu, condim=3):
    """A box 1 cm above a floor."""
    floor = f'<geom name="floor" type="plane" size="1 1 1" friction="{mu}" condim="1"/>'
    box = f'<freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1" condim="{condim}"/>'
    return compiled(f'{floor}<body pos="0 0 .11">{box}</body>', option='integrator="RK4"')


@pytest.mark.parametrize("options", WAYS)
def test_a_box_sticks_where_it_lands_by_the_largest_friction(options):
    model, data = box_above(1e4)
    data.qvel[0] = 0.2  # less than it falls: it does not tip
    stepper = Stepper(model, Moreau(0), **options)
    for _ in range(50):
        stepper.step(data)
    np.testing.assert_allclose(data.qvel, 0.0, atol=1e-8)
    assert data.qpos[0] == pytest.approx(0.2 * np.sqrt(2 * 0.01 / 9.81), abs=4e-4)  # m; a timestep early at most


@pytest.mark.parametrize("options", WAYS)
@pytest.mark.parametrize("mu", [1e5, 1e8, 1e12])
def test_more_is_refused(mu, options):
    """Time stepping let a box slide a tenth too far by 1e5, and freely by 1e8, and counted no step of that."""
    with pytest.raises(SceneError, match=r"friction up to 10000, got .* of floor/box"):
        Stepper(box_above(mu)[0], Moreau(0), **options)


@pytest.mark.parametrize("options", [*WAYS, {"contact_model": "soft"}])
def test_what_is_no_number_is_refused(options):
    """Rigid steps took a coefficient of NaN for none."""
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
