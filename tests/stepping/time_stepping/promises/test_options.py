"""Options and laws that time stepping takes, and those that have no meaning for it."""

import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.promises.started import box
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Coulomb, LinearMap, Moreau, Newton, Stepper
from impactlaw.errors import SceneError, UnknownNameError
from impactlaw.models import load


@pytest.mark.parametrize(
    "option",
    [{"gap_tolerance": 1e-9}, {"max_events": 3}, {"solver": "auto"}, {"overlap": "refuse"}],
    ids=lambda option: next(iter(option)),
)
def test_options_that_mean_nothing_to_time_stepping_are_refused(option):
    model, _ = load("bouncing_ball")
    with pytest.raises(SceneError, match=next(iter(option))):
        stepping(model, Moreau(0.5), **option)


def test_options_of_time_stepping_mean_nothing_elsewhere():
    model, _ = load("bouncing_ball")
    with pytest.raises(SceneError, match="rest_speed"):
        Stepper(model, Moreau(0.5), rest_speed=1e-3)
    with pytest.raises(SceneError, match="scheme"):
        Stepper(model, Moreau(0.5), contact_model="soft", scheme="time-stepping")


def test_an_unknown_scheme_names_the_known_ones():
    model, _ = load("bouncing_ball")
    with pytest.raises(UnknownNameError, match="time-stepping"):
        Stepper(model, Moreau(0.5), scheme="timestepping")
    with pytest.raises(UnknownNameError, match=r"event-driven.*time-stepping"):
        Stepper(model, Moreau(0.5), scheme="xyz")


def test_push_out_is_accepted_since_it_is_what_happens():
    model, data = load("bouncing_ball")
    stepping(model, Moreau(0.5), overlap="push-out").step(data)


def test_the_rest_speed_decides_what_collides():
    for rest_speed, count in ((1e-3, 1), (2.0, 0)):
        model, data = compiled(FLOOR + box("a", "0 0 .1005"), option='gravity="0 0 0"')
        data.qvel[2] = -0.5
        assert len(run(stepping(model, Newton(0.5), rest_speed=rest_speed), data, 3)) == count


def test_flexes_and_delays_are_refused():
    flex = '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" dim="2"/>'
    model, _ = compiled(FLOOR + flex)
    with pytest.raises(SceneError, match="flex"):
        stepping(model, Moreau(0))


def test_laws_keyed_by_contacts_that_cannot_be_are_refused():
    model, _ = load("bouncing_ball")
    with pytest.raises(UnknownNameError):
        stepping(model, Newton({("ball", "nothing"): 0.5}))


def test_a_linear_map_of_the_wrong_size_is_an_error_of_the_law():
    from impactlaw.errors import ImpactLawError

    model, data = load("ball_chain")
    with pytest.raises(ImpactLawError):
        stepping(model, LinearMap(np.eye(7))).step(data)


def test_a_coulomb_law_brings_its_own_cone():
    hops = []
    for cone in ("exact", "convex"):
        model, data = compiled(FLOOR + box("a", "0 0 .1"), geom='friction=".3"')
        data.qvel[0] = 2.0
        stepper, highest = stepping(model, Coulomb(Newton(0.5), cone=cone)), 0.0
        for _ in range(100):
            stepper.step(data)
            highest = max(highest, data.qpos[2] - 0.1)
        hops.append(highest)
    assert hops[0] < 1e-9
    assert hops[1] > 1e-4
