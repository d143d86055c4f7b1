"""Steps with a law in compiled code equal those that ask it in Python."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw import Coulomb, Fremond, Law, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import DivergenceError, InadmissibleImpactError, UncompiledWarning
from scripts.robots.agreement import begin_alike, compiled_stepper, difference

SCENE = """<mujoco><option timestep="0.005" integrator="{integrator}" cone="{cone}" jacobian="{jacobian}"/>
  <compiler autolimits="true"/>
  <worldbody><geom name="floor" type="plane" size="3 3 1" friction="0.7"/>
  <body pos="0 0 .4"><freejoint/><geom name="box" type="box" size=".1 .08 .06" condim="4"/></body>
  <body pos=".1 0 .7"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .01 .001"/></body>
  <body pos=".05 .1 .9"><freejoint/><geom name="egg" type="ellipsoid" size=".07 .05 .1" condim="1"/></body>
  <body pos="-.6 0 .5"><joint type="slide" axis="0 0 1" range="-.3 1" frictionloss=".4" damping=".3"/>
    <geom name="arm" type="capsule" size=".04" fromto="0 0 0 .3 0 0"/>
    <body pos=".3 0 0"><joint name="a" axis="0 1 0" range="-40 40" stiffness="1"/>
      <geom name="hand" size=".06" pos="0 0 -.1"/></body></body>
  <body pos="-.6 .5 .5"><joint name="b" axis="0 1 0" damping=".1"/><geom name="free" size=".05" pos=".1 0 0"/></body>
  </worldbody>
  <equality><joint joint1="a" joint2="b"/></equality>
  <actuator><motor joint="a" gear="2"/><position joint="b" kp="3" kv=".2"/></actuator>
  <sensor><touch site="s" name="t"/><accelerometer site="s"/></sensor></mujoco>""".replace(
    '<geom name="hand" size=".06" pos="0 0 -.1"/>',
    '<geom name="hand" size=".06" pos="0 0 -.1"/><site name="s" size=".1"/>',
)
VARIANTS = [
    {"integrator": "Euler", "cone": "pyramidal", "jacobian": "dense"},
    {"integrator": "implicitfast", "cone": "elliptic", "jacobian": "sparse"},
    {"integrator": "RK4", "cone": "pyramidal", "jacobian": "sparse"},
]
LAWS: dict[str, Law] = {
    "same": Newton(0.5),
    "elastic": Newton({"*": 1.0}),
    "pairs": Newton({("ball", "floor"): 0.9, ("box", "floor"): 0.2, "a": 0.3}, default=0.6),
    "tangential": Coulomb(Newton({"*": 0.4}), tangential_restitution=0.3),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: v["integrator"])
def test_a_law_in_compiled_code_is_that_of_python(variant: dict[str, str], name: str):
    model = mujoco.MjModel.from_xml_string(SCENE.format(**variant))
    rng = np.random.default_rng(0)
    ours = compiled_stepper(model, LAWS[name])
    python = Stepper(model, LAWS[name], scheme="time-stepping", compiled="never")
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    one.qvel[:] = other.qvel[:] = rng.normal(size=model.nv)
    collisions = 0
    for _ in range(400):
        one.ctrl[:] = other.ctrl[:] = rng.uniform(-1.0, 1.0, model.nu)
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        assert difference(one, other) < 1e-10
        assert ours.shortfall == pytest.approx(python.shortfall, abs=1e-12)
        assert len(ours.events) == len(python.events)
        for mine, theirs in zip(ours.events, python.events, strict=True):
            collisions += 1
            assert mine.contacts.labels == theirs.contacts.labels
            assert mine.time == theirs.time
            np.testing.assert_allclose(mine.impact.impulse, theirs.impact.impulse, atol=1e-9)
    assert collisions > 10
    assert ours.short_steps == python.short_steps


@pytest.mark.parametrize(
    "law", [Newton({"*": 1.0}), Coulomb(Newton({"*": 1.0}), tangential_restitution=0.1)], ids=["newton", "along"]
)
def test_rods_far_from_each_other(law: Law):
    """They collide in the same step, and some would gain energy: each is judged separately."""
    rods = "".join(
        f'<body pos="{3 * i} 0 .81"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia=".33 .33 .33"/>'
        f'<geom size=".01" pos=".6 0 -.8" friction="{0.05 * i}"/></body>'
        for i in range(8)
    )
    floor = '<option gravity="0 0 0" timestep="1e-3"/><worldbody><geom type="plane" size="30 9 1" friction="0"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{floor}{rods}</worldbody></mujoco>")
    ours, python = compiled_stepper(model, law), Stepper(model, law, scheme="time-stepping", compiled="never")
    one, other, rng, scaled = mujoco.MjData(model), mujoco.MjData(model), np.random.default_rng(0), 0
    for _ in range(60):
        one.qpos[:], one.qvel[:] = 0.0, rng.uniform(-1.0, 1.0, model.nv)
        one.qpos[1::3], one.qvel[1::3] = 3e-4, rng.uniform(-1.0, -0.5, 8)
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        np.testing.assert_allclose(one.qvel, other.qvel, rtol=0, atol=1e-9)  # the search ends at 1e-10 of the energy
        assert len(ours.events) == len(python.events)
        for mine, theirs in zip(ours.events, python.events, strict=True):
            assert mine.impact.restitution_scale == pytest.approx(theirs.impact.restitution_scale, abs=1e-9)
            target = mine.impact.target_contact_velocity / -mine.impact.collision.pre_contact_velocity
            scaled += 0 < np.count_nonzero(target < 0.99 * target.max()) < len(target)
    assert scaled > 20


@pytest.mark.parametrize("name", ["Hopper-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5"])
def test_robots_under_random_controls(name: str):
    env = gymnasium.make(name).unwrapped
    env.reset(seed=1)
    model, one = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    ours = compiled_stepper(model, Newton({"*": 0.5}))
    python = Stepper(model, Newton({"*": 0.5}), scheme="time-stepping", compiled="never")
    other, rng = copy.copy(one), np.random.default_rng(2)
    for _ in range(1000):
        one.ctrl[:] = other.ctrl[:] = rng.uniform(-0.4, 0.4, model.nu)
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        assert difference(one, other) < 1e-10
    env.close()


def _row_of_balls(apart: float) -> str:
    balls = "".join(
        f'<body pos="{(0.2 + apart) * i} {1.0 * row} 0"><joint type="slide" axis="1 0 0" limited="true" range="-1 1"/>'
        f'<geom name="b{row}{i}" size=".1" mass="1"/></body>'
        for row in range(2)
        for i in range(5)
    )
    option = '<option gravity="0 0 0" timestep=".002"/><default><geom condim="1"/></default>'
    return f"<mujoco>{option}<worldbody>{balls}</worldbody></mujoco>"


@pytest.mark.parametrize("apart", [0.0, 1e-7, 1e-3])
def test_reversal_of_two_rows_of_balls(apart: float):
    model = mujoco.MjModel.from_xml_string(_row_of_balls(apart))
    ours = compiled_stepper(model, Fremond.reversal())
    python = Stepper(model, Fremond.reversal(), scheme="time-stepping", compiled="never")
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    one.qvel[[0, 5, 6]], one.qpos[[0, 5, 6]] = 1.0, -0.01
    for step in range(1200):
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        assert difference(one, other) < 1e-10
        if step == 50 and apart == 0.0:
            np.testing.assert_allclose(one.qvel, [0, 0, 0, 0, 1, 0, 0, 0, 1, 1], atol=1e-9)


def test_copies_go_on_alike():
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    ours, one = compiled_stepper(model, Moreau(0.5)), mujoco.MjData(model)
    for _ in range(150):
        ours.step(one)
    for copied, theirs in (copy.deepcopy((ours, one)), pickle.loads(pickle.dumps((ours, one)))):
        alike, mine = copy.deepcopy((ours, one))
        for _ in range(50):
            alike.step(mine)
            copied.step(theirs)
            assert np.array_equal(mine.qpos, theirs.qpos)
            assert np.array_equal(mine.qvel, theirs.qvel)


def test_events_can_be_asked_for_later():
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    ours, one = compiled_stepper(model, Moreau(0.5)), mujoco.MjData(model)
    while not ours.events:
        ours.step(one)
    kept = one.qpos.copy()
    assert ours.events[0].impact.impulse.max() > 0.0
    assert ours.events is ours.events
    assert np.array_equal(one.qpos, kept)


def test_states_that_are_not_finite_are_refused_and_kept():
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    ours, one = compiled_stepper(model, Moreau(0.5)), mujoco.MjData(model)
    one.ctrl[0] = np.nan
    before = one.qpos.copy()
    with pytest.raises(DivergenceError, match="ctrl"):
        ours.step(one)
    assert np.array_equal(one.qpos, before)
    one.ctrl[0], model.opt.timestep = 0.0, -1.0
    with pytest.raises(Exception, match="timestep must be positive"):
        ours.step(one)
    assert one.time == 0.0


def test_laws_that_create_energy_are_refused_where_asked():
    xml = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 1" friction="1.5"/>
      <body pos="0 0 .6" euler="0 40 0"><freejoint/><geom type="capsule" size=".02" fromto="-.5 0 0 .5 0 0"/></body>
      </worldbody></mujoco>"""
    model, law = mujoco.MjModel.from_xml_string(xml), Newton({"*": 1.0})
    outcomes = []
    for compiled in ("auto", "never"):
        stepper = Stepper(model, law, scheme="time-stepping", compiled=compiled, on_inadmissible="raise")
        data = mujoco.MjData(model)
        data.qvel[0] = -6.0
        with pytest.raises(InadmissibleImpactError) as refused:
            for _ in range(800):
                stepper.step(data)
        outcomes.append(str(refused.value))
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("options", [{"scheme": "time-stepping"}, {"contact_model": "soft"}], ids=["time", "soft"])
def test_a_warning_names_the_line_of_the_user(options):
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    with pytest.warns(UncompiledWarning) as made:
        Stepper(model, Poisson(0.5), compiled="auto", **options)
    stepper = Stepper(model, Moreau(0.5), compiled="auto", **options)
    with pytest.warns(UncompiledWarning) as changed:
        stepper.law = Poisson(0.5)
    assert [one.filename for one in (*made, *changed)] == [__file__] * 2


def test_what_is_not_compiled_is_said_once():
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    law = Newton(lambda speed: 1.0 / (1.0 + speed))
    with pytest.warns(UncompiledWarning, match="function of speed"):
        ours = Stepper(model, law, scheme="time-stepping", compiled="auto")
    silent = Stepper(model, law, scheme="time-stepping")
    data = mujoco.MjData(model)
    for stepper in (ours, silent):
        mujoco.mj_resetData(model, data)
        for _ in range(100):
            stepper.step(data)
    ours.law = Moreau(0.5)
    ours.step(data)


def test_callbacks_in_python_are_called():
    model = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0]))
    ours, one = Stepper(model, Moreau(0.5), scheme="time-stepping"), mujoco.MjData(model)
    calls = []

    def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        calls.append(data.time)
        data.ctrl[0] = 0.3

    mujoco.set_mjcb_control(control)
    try:
        ours.step(one)
    finally:
        mujoco.set_mjcb_control(None)
    assert calls
    assert one.ctrl[0] == 0.3
    ours.step(one)
    assert one.time == pytest.approx(2 * model.opt.timestep)


@pytest.mark.parametrize("before", [True, False], ids=["set before the stepper is made", "set after it"])
def test_a_callback_is_heard_and_called_with_the_user_s_model_alone(before):
    model, heard = mujoco.MjModel.from_xml_string(SCENE.format(**VARIANTS[0])), []

    def control(given: mujoco.MjModel, data: mujoco.MjData) -> None:
        heard.append(given is model)

    if not before:
        ours = Stepper(model, Moreau(0.5), scheme="time-stepping", compiled="auto")
    mujoco.set_mjcb_control(control)
    try:
        if before:
            ours = Stepper(model, Moreau(0.5), scheme="time-stepping", compiled="auto")
        ours.step(mujoco.MjData(model))
    finally:
        mujoco.set_mjcb_control(None)
    assert heard == [True]


def test_errors_of_the_engine_are_exceptions():
    xml = '<size memory="18K"/><worldbody>'
    scene = SCENE.format(**VARIANTS[0]).replace("<worldbody>", xml, 1)
    model = mujoco.MjModel.from_xml_string(scene)
    ours, one = compiled_stepper(model, Moreau(0.5)), mujoco.MjData(model)
    one.qvel[:], time, before = -3.0, 0.0, one.qpos.copy()
    with pytest.raises(mujoco.FatalError, match="memory"):
        for _ in range(200):
            time, before[:] = one.time, one.qpos
            ours.step(one)
    assert one.time == time
    assert np.array_equal(one.qpos, before)


def test_linkage_that_is_thrown_into_its_limit():
    """The constraint's reference depends on velocity, and is computed again when limits are looked for once more."""
    bar = '<joint axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 -.5" contype="0" conaffinity="0"/>'
    limited = bar.replace('axis="0 1 0"', 'name="crank" axis="0 1 0" range="-60 60"')
    xml = f"""<mujoco><option timestep="0.01"/><worldbody>
      <body pos="0 0 1">{limited}<body name="a" pos="0 0 -.5">{bar.replace("0 0 -.5", ".5 0 0")}</body></body>
      <body name="b" pos=".5 0 1">{bar}</body></worldbody>
      <equality><connect body1="a" body2="b" anchor=".5 0 0"/></equality>
      <actuator><motor joint="crank" gear="2000"/></actuator></mujoco>"""
    model, law = mujoco.MjModel.from_xml_string(xml), Newton({"*": 0.5})
    ours, python = compiled_stepper(model, law), Stepper(model, law, scheme="time-stepping", compiled="never")
    one, other, rng, collisions = mujoco.MjData(model), mujoco.MjData(model), np.random.default_rng(0), 0
    for _ in range(200):
        one.ctrl[:] = other.ctrl[:] = rng.uniform(-1.0, 1.0)
        begin_alike(ours, python, one, other)
        ours.step(one)
        python.step(other)
        collisions += len(ours.events)
        assert difference(one, other) < 1e-10
    assert collisions > 10
