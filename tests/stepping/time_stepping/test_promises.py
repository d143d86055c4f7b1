"""What time stepping promises: no exceptions from contact, the model as it was, the same run twice."""

import copy
import pickle

import mujoco
import numpy as np
import pytest
from scenes import compiled, run

from impactlaw import Coulomb, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import DivergenceError, SceneError, UnknownNameError
from impactlaw.models import SCENES, load

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
LAWS = {
    "maximal dissipation": MaximalDissipation(),
    "moreau": Moreau(0.5),
    "newton of speed": Newton(lambda speed: 0.5),
    "poisson": Poisson(0.5),
    "reversal": Fremond.reversal(),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
every_scene = pytest.mark.parametrize("scene", SCENES)


def stepping(model, law, **options):
    return Stepper(model, law, scheme="time-stepping", **options)


def box(name, pos, size=0.1, more="", mass=1.0):
    return f"""<body name="{name}" pos="{pos}"><freejoint/>
        <geom name="{name}" type="box" size="{size} {size} {size}" mass="{mass}" {more}/></body>"""


def pile(n=6):
    rng = np.random.default_rng(5)
    return FLOOR + "".join(
        f'<body pos="{x} {y} {0.25 * i + 0.15}" euler="{a} {b} 0"><freejoint/>'
        f'<geom type="{kind}" size=".1 .08 .06"/></body>'
        for i, (x, y, a, b, kind) in enumerate(
            zip(
                *rng.uniform(-0.05, 0.05, (2, n)),
                *rng.uniform(-90, 90, (2, n)),
                (["box", "capsule", "ellipsoid"] * n)[:n],
                strict=True,
            )
        )
    )


# --- contact raises nothing ------------------------------------------------------------------------------------------


@every_law
@every_scene
def test_every_scene_runs_under_every_law(scene, law):
    model, data = load(scene)
    stepper = stepping(model, law)
    for _ in range(60):
        stepper.step(data)
        assert np.isfinite(stepper.shortfall)
    assert np.isfinite(data.qpos).all()
    assert stepper.unlocated == 0


HARD = {
    "overlap": FLOOR + box("a", "0 0 .02") + box("b", "0.05 0.02 .12"),
    "one in the other": box("a", "0 0 1") + box("b", "0 0 1"),
    "squeezed": '<geom type="box" size="1 1 .1"/><geom type="box" size="1 1 .1" pos="0 0 .35"/>' + box("a", "0 0 .175"),
    "squeezed ball": '<geom type="box" size="1 1 .1"/><geom type="box" size="1 1 .1" pos="0 0 .38"/>'
    '<body pos="0 0 .19"><freejoint/><geom size=".1"/></body>',
    "narrowing wedge": '<geom type="plane" size="9 9 1" zaxis="1 0 .01"/>'
    '<geom type="plane" size="9 9 1" zaxis="-1 0 .01"/>'
    '<body pos="0 0 1"><freejoint/><geom size=".1"/></body>',
}


@every_law
@pytest.mark.parametrize("name", HARD)
def test_overlapping_and_squeezed_bodies_end_without_an_exception_and_gain_no_speed(name, law):
    model, data = compiled(HARD[name], option='gravity="0 0 -9.81"', geom='friction=".5"')
    stepper = stepping(model, law)
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    highest = data.energy[0]
    for _ in range(200):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        highest = max(highest, data.energy[0])  # overlaps open upwards: that is potential energy
        assert data.energy[1] <= highest - data.energy[0] + 1e-6
        assert np.isfinite(data.qpos).all()


@pytest.mark.parametrize("depth", [1e-4, 1e-2, 0.05])
def test_overlaps_open_at_a_limited_speed_and_add_none(depth):
    """Two free balls in space: what opens is the position, both by the same amount, at 0.2 m/s or faster."""
    world = "".join(f'<body pos="{x} 0 0"><freejoint/><geom size=".1" mass="1"/></body>' for x in (0, 0.2 - depth))
    model, data = compiled(world, option='gravity="0 0 0"')
    stepper = stepping(model, Newton(0.5))
    before = 0.2 - depth
    for _ in range(300):
        stepper.step(data)
        now = data.qpos[7] - data.qpos[0]
        opened, before = now - before, now
        assert 0 <= opened <= (0.2 + depth / 0.1) * model.opt.timestep + 1e-12
        assert opened > 0.19 * model.opt.timestep or now > 0.2 - 1e-3
        assert abs(data.qvel).max() < 1e-12
    assert now == pytest.approx(0.2, abs=1e-7)
    assert data.qpos[0] + data.qpos[7] == pytest.approx(0.2 - depth, abs=1e-12)


def test_a_limit_that_is_exceeded_at_the_start_opens_over_time():
    world = '<body><joint type="hinge" axis="0 1 0" range="-10 10"/><geom size=".1" pos="0 0 -.5"/></body>'
    model, data = compiled(world, option='gravity="0 0 0"')
    data.qpos[0] = 0.5
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 1500)
    assert data.qpos[0] == pytest.approx(np.radians(10), abs=1e-6)
    assert abs(data.qvel[0]) < 1e-12


@every_law
def test_redundant_welds_hold(law):
    world = FLOOR + box("a", "0 0 .1") + box("b", "0 0 .31") + box("c", "0 0 .52")
    welds = "".join(f'<weld body1="{a}" body2="{b}"/>' for a, b in ("ab", "bc", "ac", "ab", "ca"))
    model, data = compiled(world, f"<equality>{welds}</equality>")
    data.qvel[:] = 0
    stepper = stepping(model, law)
    run(stepper, data, 100)
    assert np.isfinite(data.qpos).all()
    assert abs(data.qvel).max() < 0.5


def test_a_law_without_solution_goes_to_the_nearest_point():
    """A box whose corners ask for different speeds: no motion has them; events tell a collision all the same."""
    corners = "".join(
        f'<geom name="{n}" size=".02" pos="{x} {y} -.1"/>' for n, x, y in (
            ("a", 0.1, 0.1), ("b", -0.1, 0.1), ("c", 0.1, -0.1), ("d", -0.1, -0.1),
        )
    )  # fmt: skip
    body = f'<body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .1"/>{corners}</body>'
    model, data = compiled(FLOOR + body, geom='condim="1"')
    data.qvel[2] = -1.0
    law = Newton({("a", "floor"): 1.0, ("d", "floor"): 1.0}, default=0.0)
    stepper = stepping(model, law)
    events = run(stepper, data, 200)
    assert events
    assert events[0].contacts.labels
    assert np.isfinite(data.qpos).all()


def test_thousands_of_rows_are_no_error():
    """A thousand balls of a grid on the floor, with friction, in touch with it all at once."""
    balls = "".join(
        f'<body pos="{0.21 * (i % 32)} {0.21 * (i // 32)} .1"><freejoint/><geom size=".1"/></body>' for i in range(1000)
    )
    model, data = compiled('<geom type="plane" size="99 99 1"/>' + balls)
    assert model.nv == 6000
    start = data.qpos.copy()
    stepper = stepping(model, Moreau(0.5))
    for _ in range(2):
        stepper.step(data)
    assert data.nefc > 2999
    assert data.qpos == pytest.approx(start, abs=1e-9)
    assert stepper.shortfall < 1e-8


def test_a_box_on_a_grid_of_sixty_four_coplanar_feet_stays():
    feet = "".join(
        f'<geom size=".01" pos="{x} {y} -.09"/>' for x in np.linspace(-1, 1, 8) for y in np.linspace(-1, 1, 8)
    )
    body = f'<body pos="0 0 .1"><freejoint/><geom type="box" size="1 1 .09" contype="0" conaffinity="0"/>{feet}</body>'
    model, data = compiled(FLOOR + body)
    start = data.qpos.copy()
    stepper = stepping(model, Moreau(0.5))
    assert run(stepper, data, 50) == []
    assert data.qpos == pytest.approx(start, abs=1e-9)


# --- what is not finite ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("field", ["qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied", "act"])
def test_what_is_not_finite_raises_and_leaves_everything_as_it_was(field, value, quiet):
    world = FLOOR + '<body pos="0 0 .1"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model, data = compiled(world, '<actuator><general joint="up" dyntype="integrator" gainprm="1"/></actuator>')
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 3)
    array = getattr(data, field)
    array.reshape(-1)[0] = value
    before = {name: getattr(data, name).copy() for name in ("qpos", "qvel", "act", "ctrl", "mocap_pos")}
    flags, time = model_state(model), data.time
    with pytest.raises(DivergenceError):
        stepper.step(data)
    for name, old in before.items():
        np.testing.assert_array_equal(getattr(data, name), old)
    assert data.time == time
    assert_same(model_state(model), flags)
    mujoco.mj_resetData(model, data)
    run(stepper, data, 3)
    assert np.isfinite(data.qpos).all()


def test_an_explosion_within_a_step_raises_and_restores(quiet):
    world = '<body><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model, data = compiled(world, '<actuator><motor joint="up" gear="1e9"/></actuator>')
    data.ctrl[0] = 1e9
    stepper = stepping(model, Moreau(0.5))
    with pytest.raises(DivergenceError):
        run(stepper, data, 10)
    assert np.isfinite(data.qpos).all()
    assert np.isfinite(data.qvel).all()


# --- the model and the data ------------------------------------------------------------------------------------------


def model_state(model):
    """All that a model holds, as bytes."""
    opt = {name: np.array(getattr(model.opt, name)) for name in dir(model.opt) if not name.startswith("_")}
    arrays = {
        name: getattr(model, name).copy()
        for name in dir(model)
        if not name.startswith("_") and isinstance(getattr(model, name), np.ndarray)
    }
    return opt | arrays


def assert_same(now, before):
    assert now.keys() == before.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(now[name], value, err_msg=name)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
def test_the_model_is_after_every_step_what_it_was_before(cone, jacobian):
    option = f'integrator="RK4" cone="{cone}" jacobian="{jacobian}" solver="CG" impratio="3"'
    world = pile(4).replace("<geom", '<geom margin="0.01" gap="0.005"', 3)
    world += '<body pos="3 0 0"><joint name="j" axis="0 1 0" range="-10 10" margin=".02"/>'
    world += '<geom size=".1" pos="0 0 .5"/></body>'
    tendon = '<tendon><fixed range="-1 1" margin=".03"><joint joint="j" coef="1"/></fixed></tendon>'
    model, data = compiled(world, tendon, option=option)
    stepper = stepping(model, Moreau(0.5))
    before = model_state(model)
    for _ in range(40):
        stepper.step(data)
        assert_same(model_state(model), before)


def test_the_model_is_what_it_was_after_an_exception_within_a_step():
    model, data = compiled(pile(3).replace("<geom", '<geom margin="0.01" gap="0.005"', 2), option='integrator="RK4"')
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 5)
    before, qpos, qvel, time = model_state(model), data.qpos.copy(), data.qvel.copy(), data.time

    def broken(model, data):
        raise ZeroDivisionError

    mujoco.set_mjcb_control(broken)
    try:
        with pytest.raises(ZeroDivisionError):
            stepper.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert_same(model_state(model), before)
    np.testing.assert_array_equal(data.qpos, qpos)
    np.testing.assert_array_equal(data.qvel, qvel)
    assert data.time == time
    reference = mujoco.MjData(model)
    reference.qpos[:], reference.qvel[:], reference.time = qpos, qvel, time
    stepping(model, Moreau(0.5)).step(reference)
    stepper.step(data)
    assert data.qpos == pytest.approx(reference.qpos, abs=1e-9)


def trajectory(model, stepper, data, steps):
    seen = []
    for _ in range(steps):
        stepper.step(data)
        seen.append(np.concatenate([data.qpos, data.qvel, [data.time]]))
    return np.array(seen)


@every_scene
def test_the_same_run_twice_is_the_same_bit_for_bit(scene):
    runs = []
    for _ in range(2):
        model, data = load(scene)
        runs.append(trajectory(model, stepping(model, Moreau(0.6)), data, 120))
    np.testing.assert_array_equal(*runs)


def test_a_pile_is_the_same_twice_bit_for_bit():
    runs = []
    for _ in range(2):
        model, data = compiled(pile())
        runs.append(trajectory(model, stepping(model, Moreau(0.6)), data, 120))
    np.testing.assert_array_equal(*runs)


def test_two_steppers_on_one_model_do_not_disturb_each_other():
    model, one = compiled(pile())
    two = mujoco.MjData(model)
    alone = trajectory(model, stepping(model, Moreau(0.6)), mujoco.MjData(model), 60)
    a, b = stepping(model, Moreau(0.6)), stepping(model, Moreau(0.0))
    together = []
    for _ in range(60):
        a.step(one)
        b.step(two)
        together.append(np.concatenate([one.qpos, one.qvel, [one.time]]))
    np.testing.assert_array_equal(together, alone)
    assert not np.array_equal(one.qpos, two.qpos)


def test_one_stepper_steps_several_data_in_turn():
    model, one = compiled(pile(3))
    alone = trajectory(model, stepping(model, Moreau(0.6)), mujoco.MjData(model), 60)
    two, stepper, together = mujoco.MjData(model), stepping(model, Moreau(0.6)), []
    two.qpos[0] += 0.3
    for _ in range(60):
        stepper.step(one)
        stepper.step(two)
        together.append(np.concatenate([one.qpos, one.qvel, [one.time]]))
    assert np.array(together) == pytest.approx(alone, abs=1e-6)


def test_data_of_a_reset_go_on_as_those_of_a_new_stepper():
    model, data = load("ball_stack")
    stepper = stepping(model, Moreau(0.5))
    first = trajectory(model, stepper, data, 150)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    again = trajectory(model, stepper, data, 150)
    np.testing.assert_array_equal(again, first)


def test_a_state_that_is_set_between_steps_is_taken():
    model, data = compiled(FLOOR + box("a", "0 0 .1"))
    stepper = stepping(model, Newton(0.5))
    run(stepper, data, 10)
    data.qpos[2], data.qvel[2] = 0.1 + 1e-4, -3.0
    (event,) = run(stepper, data, 1)
    assert event.impact.collision.pre_velocity[2] == -3.0
    assert data.qvel[2] == pytest.approx(1.5, abs=1e-9)


def test_data_of_another_model_are_refused():
    model, _ = load("billiard_rack")
    _, data = load("bouncing_ball")
    with pytest.raises(SceneError, match="another model"):
        stepping(model, Moreau(1)).step(data)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))])
def test_copies_and_pickles_go_on_like_the_original(duplicate):
    model, data = load("bouncing_ball")
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 60)
    other, copied = duplicate((stepper, data))
    mine = trajectory(model, stepper, data, 80)
    theirs = trajectory(other.model, other, copied, 80)
    np.testing.assert_array_equal(mine, theirs)


def test_copied_data_go_on_like_the_original():
    model, data = compiled(pile())
    run(stepping(model, Moreau(0.5)), data, 30)
    runs = [trajectory(model, stepping(model, Moreau(0.5)), copy.copy(data), 40) for _ in range(2)]
    np.testing.assert_array_equal(*runs)


def test_changes_of_the_model_between_steps_take_effect():
    model, data = compiled(FLOOR + box("a", "0 0 .1"), geom='friction="1"', option='gravity="3 0 -9.81"')
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 5)
    assert abs(data.qvel).max() < 1e-9
    model.geom_friction[:, 0] = 0.1
    run(stepper, data, 10)
    assert data.qvel[0] == pytest.approx(10 * 0.002 * (3 - 0.981), abs=1e-9)
    model.opt.gravity[:] = 0, 0, 1.0
    before = data.qvel.copy()
    stepper.step(data)
    assert data.qvel[2] == pytest.approx(0.002, abs=1e-9)
    assert data.qvel[0] == pytest.approx(before[0], abs=1e-9)
    model.opt.timestep = 0.004
    time = data.time
    stepper.step(data)
    assert data.time == pytest.approx(time + 0.004, abs=1e-15)
    model.body_mass[1] *= 4
    model.body_inertia[1] *= 4
    mujoco.mj_setConst(model, mujoco.MjData(model))
    data.xfrc_applied[1, 0] = 8.0
    before = data.qvel[0]
    stepper.step(data)
    assert data.qvel[0] == pytest.approx(before + 0.004 * 8 / 4, abs=1e-9)


@pytest.mark.parametrize("flag", ["CONTACT", "CONSTRAINT", "LIMIT", "GRAVITY", "FRICTIONLOSS", "EQUALITY"])
def test_what_is_disabled_is_off(flag):
    world = (
        FLOOR
        + """<body pos="0 0 .1"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body>
        <body pos="3 0 3"><joint name="low" type="slide" axis="0 0 1" range="0 1"/><geom size=".1"/></body>
        <body pos="6 0 3"><joint name="dry" type="slide" axis="0 0 1" frictionloss="1000"/><geom size=".1"/></body>
        <body pos="8 0 3"><joint name="held" type="slide" axis="0 0 1"/><geom size=".1"/></body>"""
    )
    model, data = compiled(world, '<equality><joint joint1="held"/></equality>')
    model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    run(stepping(model, Moreau(0)), data, 50)
    falls = {
        "CONTACT": [1, 0, 0, 0], "CONSTRAINT": [1, 1, 1, 1], "LIMIT": [0, 1, 0, 0], "GRAVITY": [0, 0, 0, 0],
        "FRICTIONLOSS": [0, 0, 1, 0], "EQUALITY": [0, 0, 0, 1],
    }[flag]  # fmt: skip
    fallen = -0.5 * 9.81 * 0.1**2
    assert data.qpos == pytest.approx(fallen * np.array(falls), abs=2e-3)


# --- options ---------------------------------------------------------------------------------------------------------


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
