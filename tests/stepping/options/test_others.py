"""Options of a stepper other than the law: read, fixed, copied, and refused if invalid."""

import copy
import math
import pickle

import mujoco
import numpy as np
import pytest
from stepping.options.ways import WAYS, ball, every_way, rebound

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper, read_contacts
from impactlaw.errors import (
    DivergenceError,
    ImpactLawError,
    OptionError,
    SceneError,
    SettledError,
)
from impactlaw.models import load


@every_way
@pytest.mark.parametrize(
    "name",
    [
        "model", "plan", "contact_model", "scheme", "friction", "overlap", "on_inadmissible", "gap_tolerance",
        "rest_speed", "max_events", "solver", "on_unsolved", "compiled", "contacts", "limits",
    ],
)  # fmt: skip
def test_other_options_can_be_read_and_setting_them_is_an_error(way, name):
    stepper = Stepper(ball()[0], Moreau(0.5), **WAYS[way])
    before = getattr(stepper, name)
    with pytest.raises(SettledError, match=rf"{name} of Stepper .* make a new Stepper"):
        setattr(stepper, name, "ignore")
    assert getattr(stepper, name) is before


@every_way
@pytest.mark.parametrize("name", ["restitution", "lav", "events"])
def test_what_is_no_option_cannot_be_set(way, name):
    stepper = Stepper(ball()[0], Moreau(0.5), **WAYS[way])
    with pytest.raises(AttributeError, match=name):
        setattr(stepper, name, 0.3)


@pytest.mark.parametrize("way", ["soft", "time-stepping"])
@pytest.mark.parametrize("speed", [math.nan, -0.1, math.inf, "fast", True, False])
def test_a_rest_speed_that_is_none(way, speed):
    with pytest.raises(OptionError, match="rest_speed must be a speed"):
        Stepper(ball()[0], Moreau(0.5), rest_speed=speed, **WAYS[way])


@pytest.mark.parametrize("length", [0.0, -1e-9, math.nan, math.inf, "small", True])
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
@pytest.mark.parametrize("timestep", [0.0, -0.01, math.nan, math.inf])
def test_a_timestep_that_is_none(way, timestep):
    model, data = ball()
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    model.opt.timestep = timestep
    with pytest.raises(SceneError, match="timestep must be positive"):
        stepper.step(data)
    assert data.time == 0.0
    assert np.isfinite(data.qpos).all()
    with pytest.raises(SceneError, match="timestep must be positive"):
        Stepper(model, Moreau(0.5), **WAYS[way])


@every_way
@pytest.mark.parametrize("field", ["mocap_pos", "mocap_quat"])
@pytest.mark.usefixtures("quiet")
def test_a_surface_that_is_nowhere(way, field):
    """Regression: it was ignored, and the ball fell through it."""
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


def test_what_stands_for_a_model_is_refused_with_the_way_to_one():
    mjcf = pytest.importorskip("dm_control.mjcf", reason="dm_control is not installed")
    physics = mjcf.Physics.from_xml_string("<mujoco/>")
    for refused in (lambda: Stepper(physics.model, Moreau(0.5)), lambda: read_contacts(physics.model, physics.data)):
        with pytest.raises(SceneError, match=r"got .* \(dm_control's wrapper: .*physics\.model\.ptr"):
            refused()
    stepper = Stepper(physics.model.ptr, Moreau(0.5))
    with pytest.raises(SceneError, match=r"physics\.data\.ptr"):
        stepper.step(physics.data)
    stepper.step(physics.data.ptr)
    with pytest.raises(SceneError, match=r"MjSpec object .* its method compile\(\)"):
        Stepper(mujoco.MjSpec(), Moreau(0.5))  # pyright: ignore[reportArgumentType]


def test_the_event_of_time_stepping_says_how_much_restitution_was_left():
    """Newton's restitution and friction would create energy (Kane): restitution is scaled, as the event tells."""
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


def test_data_of_another_model_is_refused_by_both_halves_of_a_soft_step():
    stepper = Stepper(ball()[0], Moreau(0.5), contact_model="soft")
    for step in (stepper.step, stepper.finish_step):
        with pytest.raises(SceneError, match="another model"):
            step(load("box_drop")[1])


@every_way
@pytest.mark.parametrize("of", [lambda model: None, lambda model: model], ids=["nothing", "the model"])
def test_what_is_no_data_is_refused(way, of):
    model = ball()[0]
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    with pytest.raises(SceneError, match=r"data is the mujoco\.MjData of the scene, got"):
        stepper.step(of(model))


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
