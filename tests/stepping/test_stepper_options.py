"""What a stepper is told it does, at once or from the next step on; anything else it refuses when it is told."""

import copy
import math
import pickle

import mujoco
import numpy as np
import pytest

from impactlaw import Coulomb, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import (
    DivergenceError,
    ImpactLawError,
    OptionError,
    RestitutionError,
    SceneError,
    SettledError,
    UnknownNameError,
)
from impactlaw.models import load

WAYS = {
    "soft": {"contact_model": "soft"},
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
}
every_way = pytest.mark.parametrize("way", WAYS)


def ball(condim=1, option="", numeric=""):
    """A ball 1 m above a floor."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002" {option}/><custom>{numeric}</custom>
      <worldbody><geom name="floor" type="plane" size="1 1 1" condim="{condim}"/>
      <body pos="0 0 1.1"><freejoint/><geom name="ball" size=".1" mass="1" condim="{condim}"/></body></worldbody>
      </mujoco>""")
    return model, mujoco.MjData(model)


def rebound(stepper, data):
    """The part of its speed that the ball keeps in its next collision."""
    for _ in range(2000):
        stepper.step(data)
        if stepper.events:
            impact = stepper.events[0].impact
            return -impact.post_contact_velocity[0] / impact.collision.pre_contact_velocity[0]
    raise AssertionError("the ball has not hit the floor")


# The law


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
    """To the last bit, in the middle of a run too."""
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
    """A law with a rule of its own that Coulomb knows nothing of."""

    def resolve(self, collision, *, solver="auto"):
        return super().resolve(collision, solver=solver)


def test_a_law_without_friction_is_refused_where_the_constructor_refuses_it():
    stepper = Stepper(ball(3)[0], Moreau(0.9))
    with pytest.raises(RestitutionError, match="rule of its own"):
        stepper.law = Own(0.5)
    assert stepper.law == Moreau(0.9)


# Everything else


@every_way
@pytest.mark.parametrize(
    "name",
    [
        "model", "plan", "contact_model", "scheme", "friction", "overlap", "on_inadmissible", "gap_tolerance",
        "rest_speed", "max_events", "solver",
    ],
)  # fmt: skip
def test_other_options_can_be_read_and_setting_them_is_an_error(way, name):
    stepper = Stepper(ball()[0], Moreau(0.5), **WAYS[way])
    before = getattr(stepper, name)
    with pytest.raises(SettledError, match=rf"{name} of Stepper .* make a new Stepper"):
        setattr(stepper, name, "ignore")
    assert getattr(stepper, name) is before


@pytest.mark.parametrize("way", ["soft", "time-stepping"])
@pytest.mark.parametrize("speed", [math.nan, -0.1, math.inf, "fast"])
def test_a_rest_speed_that_is_none(way, speed):
    with pytest.raises(OptionError, match="rest_speed must be a speed"):
        Stepper(ball()[0], Moreau(0.5), rest_speed=speed, **WAYS[way])


@pytest.mark.parametrize("length", [0.0, -1e-9, math.nan, math.inf, "small"])
def test_a_gap_tolerance_that_is_none(length):
    with pytest.raises(OptionError, match="gap_tolerance must be a positive length"):
        Stepper(ball()[0], Moreau(0.5), gap_tolerance=length)


@pytest.mark.parametrize("way", ["soft", "event-driven"])
@pytest.mark.parametrize("count", [0, -1, math.nan, 2.5])
def test_a_number_of_events_that_is_none(way, count):
    with pytest.raises(OptionError, match="max_events must be a whole number"):
        Stepper(ball()[0], Moreau(0.5), max_events=count, **WAYS[way])


def test_a_number_of_numpy_is_a_number():
    Stepper(ball()[0], Moreau(0.5), contact_model="soft", rest_speed=np.float32(0.1), max_events=np.int64(3))


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
    """The rest of the numbers was ignored; with a size and no data it was 0."""
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


@every_way
@pytest.mark.parametrize("timestep", [0.0, -0.01, math.nan, math.inf])
def test_a_timestep_that_is_none(way, timestep):
    model, data = ball()
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    model.opt.timestep = timestep
    with pytest.raises(SceneError, match="timestep must be positive"):
        stepper.step(data)
    assert data.time == 0.0
    assert np.isfinite(data.qpos).all()


@every_way
@pytest.mark.parametrize("field", ["mocap_pos", "mocap_quat"])
@pytest.mark.usefixtures("quiet")
def test_a_surface_that_is_nowhere(way, field):
    """It was ignored, and the ball fell through it."""
    model, data = load("juggler")
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    stepper.step(data)
    getattr(data, field)[0] = math.nan
    with pytest.raises(DivergenceError):
        stepper.step(data)


@pytest.mark.parametrize("scheme", ["event-driven", "time-stepping"])
def test_a_time_that_is_none(scheme):
    model, data = ball()
    stepper = Stepper(model, Moreau(0.5), scheme=scheme)
    data.time = math.nan
    with pytest.raises(DivergenceError, match="time is not finite"):
        stepper.step(data)


def test_a_path_is_no_model():
    with pytest.raises(SceneError, match=r"a model is a mujoco\.MjModel, got 'scene\.xml'"):
        Stepper("scene.xml", Moreau(0.5))


def test_the_event_of_time_stepping_says_how_much_restitution_was_left():
    """Newton's restitution and friction would create energy (Kane): all of it is scaled, and the event says so."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody>
      <geom name="floor" type="plane" size="5 5 1" friction="0.7"/>
      <body pos="0 0 .805" euler="0 37 0"><freejoint/><geom type="capsule" size=".005 1" mass="1" friction="0.7"/>
      </body>      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:3] = 1.0, 0.0, -1.0
    stepper = Stepper(model, Newton(1.0), scheme="time-stepping")
    scale = None
    for _ in range(200):
        stepper.step(data)
        if stepper.events:
            scale = stepper.events[0].impact.restitution_scale
            break
    assert scale is not None
    located = Stepper(model, Newton(1.0))
    mujoco.mj_resetData(model, data)
    data.qvel[:3] = 1.0, 0.0, -1.0
    while not located.events:
        located.step(data)
    wanted = located.events[0].impact.restitution_scale
    assert 0.0 < wanted < 1.0
    assert scale == pytest.approx(wanted, abs=1e-2)


def test_other_ways_options_mean_nothing_to_soft_steps():
    for option in ({"scheme": "time-stepping"}, {"overlap": "push-out"}, {"gap_tolerance": 1e-9}):
        with pytest.raises(SceneError, match="means nothing to soft steps"):
            Stepper(ball(3)[0], Moreau(0.5), contact_model="soft", **option)


@pytest.mark.parametrize("steps", [0, -1, 1.5, "2"])
@pytest.mark.parametrize("options", [{}, {"contact_model": "soft"}])
def test_steps_are_a_count(steps, options):
    model, data = ball(3)
    with pytest.raises(OptionError, match="steps must be a whole number"):
        Stepper(model, Moreau(0.5), **options).step(data, steps)
    assert data.time == 0.0


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
def test_several_steps_are_those_one_by_one(options):
    model, data = ball(3)
    data.qvel[:3] = 1.0, 0.0, -1.0
    other = mujoco.MjData(model)
    other.qvel[:] = data.qvel
    one, several = Stepper(model, Newton(0.5), **options), Stepper(model, Newton(0.5), **options)
    for _ in range(40):
        events = []
        for _ in range(5):
            one.step(data)
            events += one.events
        several.step(other, 5)
        assert [event.time for event in several.events] == [event.time for event in events]
        np.testing.assert_array_equal(other.qpos, data.qpos)
        np.testing.assert_array_equal(other.qvel, data.qvel)
        assert several.sums.collisions == len(events)
        assert several.sums.energy_change == pytest.approx(sum(event.impact.energy_change for event in events))


@pytest.mark.parametrize("scheme", ["event-driven", "time-stepping"])
def test_friction_of_the_law_and_of_the_option_do_not_contradict(scheme):
    for friction, cone in (("ignore", "exact"), ("convex", "exact"), ("coulomb", "convex")):
        with pytest.raises(RestitutionError, match="friction"):
            Stepper(ball(3)[0], Coulomb(Moreau(0.5), cone=cone), friction=friction, scheme=scheme)
    Stepper(ball(3)[0], Coulomb(Moreau(0.5), cone="convex"), friction="convex", scheme=scheme)
    stepper = Stepper(ball(3)[0], Moreau(0.5), friction="ignore", scheme=scheme)
    with pytest.raises(RestitutionError, match="leaves friction out"):
        stepper.law = Coulomb(Moreau(0.5))


def test_data_of_another_model_is_refused_by_both_halves_of_a_soft_step():
    stepper = Stepper(ball()[0], Moreau(0.5), contact_model="soft")
    for step in (stepper.step, stepper.finish_step):
        with pytest.raises(SceneError, match="another model"):
            step(load("box_drop")[1])


@every_way
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))], ids=["copy", "pickle"]
)
def test_a_copy_has_the_options_of_its_own_model(way, copied):
    model, data = ball(3)
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    stepper.step(data)
    twin, its = copied((stepper, data))
    twin.model.opt.timestep = 0.001
    twin.step(its)
    assert its.time == pytest.approx(0.003)
    stepper.step(data)
    assert data.time == pytest.approx(0.004)
    twin.law = Moreau(0.25)
    assert (stepper.law, twin.law) == (Moreau(0.5), Moreau(0.25))
    assert rebound(twin, its) == pytest.approx(0.25, abs=1e-6)


def test_errors_of_options_are_of_this_package():
    assert issubclass(SettledError, ImpactLawError)
    assert issubclass(SettledError, AttributeError)
    assert issubclass(OptionError, ImpactLawError)
    stepper = Stepper(ball()[0], MaximalDissipation())
    assert not hasattr(stepper, "no_such_thing")


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
