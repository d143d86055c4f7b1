"""Setting another law on a stepper: it holds from the next step on, or is refused at once."""

import copy

import mujoco
import numpy as np
import pytest
from stepping.options.ways import WAYS, ball, every_way, rebound

from impactlaw import Batch, Coulomb, Fremond, LinearMap, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import (
    RestitutionError,
    SceneError,
    UnknownNameError,
)
from impactlaw.models import load


@every_way
@pytest.mark.parametrize("condim", [1, 3])
def test_another_law_takes_effect_with_the_next_step(way, condim):
    model, data = ball(condim)
    stepper = Stepper(model, Moreau(0.9), **WAYS[way])
    seen = []
    for law in (Moreau(0.9), Newton(0.8), Newton({("ball", "floor"): 0.6}), Fremond.reversal(0.7), Moreau(0.5)):
        stepper.law = law
        assert stepper.law is law
        seen.append(rebound(stepper, data))
    assert seen == pytest.approx([0.9, 0.8, 0.6, 0.7, 0.5], abs=1e-9)


@every_way
def test_the_next_step_is_as_of_a_stepper_made_with_that_law(way):
    """The step is equal to the last bit, also in the middle of a run."""
    ends = []
    for change in (True, False):
        model, data = ball(3)
        data.qvel[0] = 1.0
        stepper = Stepper(model, Moreau(0.9 if change else 0.5), **WAYS[way])
        for i in range(600):
            if change and i == 100:
                stepper.law = Moreau(0.5)
            stepper.step(data)
        ends.append(np.append(data.qpos, data.qvel))
    np.testing.assert_array_equal(*ends)


def test_tangential_restitution_and_cone_come_with_the_law():
    for scheme in ("event-driven", "time-stepping"):
        model, data = ball(3)
        data.qvel[0] = 1.0
        stepper = Stepper(model, Moreau(0.5), scheme=scheme)
        stepper.law = Coulomb(Moreau(0.5), tangential_restitution=1.0)
        assert rebound(stepper, data) == pytest.approx(0.5, abs=1e-9)
        impact = stepper.events[0].impact
        np.testing.assert_allclose(impact.post_sliding_velocity, -impact.pre_sliding_velocity, atol=1e-9)
        assert np.linalg.norm(impact.pre_sliding_velocity) > 0.9


@every_way
def test_the_law_of_the_scene_can_be_set(way):
    model, data = ball(numeric='<numeric name="restitution/ball/floor" data="0.3"/>')
    stepper = Stepper(model, Moreau(0.9), **WAYS[way])
    stepper.law = "scene"
    assert rebound(stepper, data) == pytest.approx(0.3, abs=1e-9)


@every_way
def test_the_law_of_the_scene_follows_the_scene(way):
    """Steppers, their copies and laws put on environments read again what randomization has written."""
    model, data = ball(numeric='<numeric name="restitution" data="0.3"/>')
    stepper = Stepper(model, "scene", **WAYS[way])
    model.numeric_data[0] = 0.8
    copied, own = copy.deepcopy((stepper, mujoco.MjData(model)))
    assert rebound(copied, own) == pytest.approx(0.8, abs=1e-9)
    copied.model.numeric_data[0] = 0.4
    assert rebound(copied, own) == pytest.approx(0.4, abs=1e-9)
    assert rebound(stepper, data) == pytest.approx(0.8, abs=1e-9)
    assert stepper.law == Newton({}, default=0.8)
    model.numeric_data[0], before = 1.5, data.qpos.copy()
    for _ in range(2):  # it does not go on under the old law
        with pytest.raises(RestitutionError, match=r"must lie in \[0, 1\], got 1.5"):
            stepper.step(data)
    np.testing.assert_array_equal(data.qpos, before)
    stepper.law = Moreau(0.5)
    assert rebound(stepper, data) == pytest.approx(0.5, abs=1e-9)
    model.numeric_data[0] = 0.2
    assert rebound(stepper, data) == pytest.approx(0.5, abs=1e-9)


def test_the_second_half_of_a_soft_step_follows_the_scene():
    model, data = ball(numeric='<numeric name="restitution" data="0.3"/>')
    stepper, seen = Stepper(model, "scene", contact_model="soft"), []
    model.numeric_data[0] = 0.8
    while not seen:
        mujoco.mj_step1(model, data)
        stepper.finish_step(data)
        seen = [-e.impact.post_contact_velocity[0] / e.impact.collision.pre_contact_velocity[0] for e in stepper.events]
    assert seen == pytest.approx([0.8], abs=1e-9)


def test_a_batch_refuses_restitution_of_the_scene_by_world():
    """It would have no effect, since a batch is under a law."""
    model, _ = ball(numeric='<numeric name="restitution" data="0.3"/>')
    with pytest.raises(SceneError, match="write into `restitution` of the batch"):
        Batch(model, Moreau(0.5), 2).expand("numeric_data")
    model, _ = ball(numeric='<numeric name="mine" data="0.3"/>')
    assert Batch(model, Moreau(0.5), 2).expand("numeric_data").shape == (2, 1)


@every_way
@pytest.mark.parametrize(
    ("law", "error"),
    [
        ("moreau", UnknownNameError),
        (None, UnknownNameError),
        (Newton({("ball", "flor"): 0.5}), UnknownNameError),
        (Newton([0.5, 0.5]), RestitutionError),
        ("scene", RestitutionError),
    ],
    ids=str,
)
def test_a_law_that_does_not_fit_is_refused_and_the_old_one_stays(way, law, error):
    model, data = ball()
    stepper = Stepper(model, Moreau(0.9), **WAYS[way])
    with pytest.raises(error):
        stepper.law = law
    assert stepper.law == Moreau(0.9)
    assert rebound(stepper, data) == pytest.approx(0.9, abs=1e-9)


class Own(Poisson):
    """A law with its own rule, which Coulomb does not know."""

    def resolve(self, collision, *, solver="auto"):
        return super().resolve(collision, solver=solver)


def test_a_law_without_friction_is_refused_where_the_constructor_refuses_it():
    stepper = Stepper(ball(3)[0], Moreau(0.9))
    with pytest.raises(RestitutionError, match="rule of its own"):
        stepper.law = Own(0.5)
    assert stepper.law == Moreau(0.9)


@every_way
@pytest.mark.parametrize(
    ("law", "message"),
    [
        (Newton([0.2, 0.9]), "for 2 contacts, but the scene never has more than 1"),
        (Poisson([0.2, 0.9]), "for 2 contacts"),
        (Fremond(np.eye(3)), "for 3 contacts"),
        (Coulomb(Newton([0.2, 0.9])), "for 2 contacts"),
        (LinearMap(np.eye(3)), "3 degrees of freedom, but the scene has 6"),
    ],
    ids=repr,
)
def test_coefficients_for_more_contacts_than_there_can_be(way, law, message):
    with pytest.raises(RestitutionError, match=message):
        Stepper(ball()[0], law, **WAYS[way])


def test_as_many_coefficients_as_contacts_are_taken():
    for law in (Newton([0.5]), Fremond([[0.5]])):
        model, data = ball()
        assert rebound(Stepper(model, law), data) == pytest.approx(0.5, abs=1e-9)
    Stepper(load("ball_chain")[0], Fremond([[0, 1], [1, 0]]))
    Stepper(load("box_drop")[0], Newton([0.5] * 4))


@every_way
def test_restitution_of_the_scene_between_geoms_that_cannot_meet(way):
    model, _ = ball(numeric='<numeric name="restitution/ball/ghost" data="0.3"/>')
    with pytest.raises(UnknownNameError, match="ball/ghost"):
        Stepper(model, "scene", **WAYS[way])
    both = '<geom name="ball" size=".1"/><geom name="hat" size=".1" pos="0 0 .1"/>'
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><custom><numeric name="restitution/ball/hat" data="0.3"/></custom>'
        f"<worldbody><body><freejoint/>{both}</body></worldbody></mujoco>"
    )
    with pytest.raises(UnknownNameError, match="ball/hat"):
        Stepper(model, "scene", **WAYS[way])


@pytest.mark.parametrize("data", ["0.5 0.9", None], ids=["two numbers", "three zeros"])
@pytest.mark.parametrize("name", ["restitution", "restitution/ball/floor"])
def test_restitution_of_the_scene_is_one_number(name, data):
    """Regression: further numbers were ignored; with a size and no data it was 0."""
    given = 'size="3"' if data is None else f'data="{data}"'
    model, _ = ball(numeric=f'<numeric name="{name}" {given}/>')
    with pytest.raises(RestitutionError, match=f"{name} of the scene must be one number"):
        Stepper(model, "scene")


@pytest.mark.parametrize(
    "make",
    [
        lambda: Stepper(ball()[0], Newton([])),
        lambda: Stepper(ball()[0], Fremond(np.zeros((0, 0)))),
        lambda: Stepper(ball()[0], LinearMap(np.zeros((0, 0)))),
        lambda: Poisson({}),
        lambda: Newton({0.5, 0.9}),
    ],
)
def test_laws_without_coefficients_or_an_order_of_them(make):
    with pytest.raises(RestitutionError):
        make()


@pytest.mark.parametrize("scheme", ["event-driven", "time-stepping"])
def test_friction_of_the_law_and_of_the_option_do_not_contradict(scheme):
    for friction, cone in (("ignore", "exact"), ("convex", "exact"), ("coulomb", "convex")):
        with pytest.raises(RestitutionError, match="friction"):
            Stepper(ball(3)[0], Coulomb(Moreau(0.5), cone=cone), friction=friction, scheme=scheme)
    Stepper(ball(3)[0], Coulomb(Moreau(0.5), cone="convex"), friction="convex", scheme=scheme)
    stepper = Stepper(ball(3)[0], Moreau(0.5), friction="ignore", scheme=scheme)
    with pytest.raises(RestitutionError, match="leaves friction out"):
        stepper.law = Coulomb(Moreau(0.5))


def test_a_law_that_names_only_some_contacts_of_the_scene_is_refused_when_made():
    balls = "".join(f'<body pos="0 0 {z}"><freejoint/><geom name="b{z}" size=".1"/></body>' for z in (1, 2))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>{balls}</worldbody></mujoco>'
    )
    some = {("b1", "floor"): 0.5, ("b2", "floor"): 0.5}
    for contact_model in ("rigid", "soft"):
        for law in (Newton(some), Poisson(some)):
            with pytest.raises(RestitutionError, match="no restitution for contacts that the scene can have: b1/b2; "):
                Stepper(model, law, contact_model=contact_model)
        Stepper(model, Newton(some, default=0.0), contact_model=contact_model)
        stepper = Stepper(model, Newton(some | {("b1", "b2"): 0.1}), contact_model=contact_model)
        with pytest.raises(RestitutionError, match="b1/b2"):
            stepper.law = Newton(some)
