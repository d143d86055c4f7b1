"""Equality constraints of MuJoCo scenes: exact collisions in minimal coordinates, rigid and soft stepping."""

from functools import partial

import mujoco
import numpy as np
import pytest
import scenes
from scenes import run

from impactlaw import Collision, Moreau, Newton, Stepper
from impactlaw.errors import UnsolvableLawError
from impactlaw.scene.contacts import update_positions

STILL = 'gravity="0 0 0" timestep="0.002" integrator="RK4"'
EULER = STILL.replace("RK4", "Euler")
FLOOR = '<geom name="floor" type="plane" size="1 1 1"/>'


compiled = partial(scenes.compiled, option=STILL, geom='condim="1"')


def welded(count, relation):
    """Return boxes of edge 0.2 in a row along x, each tied by an equality to the next two."""
    bodies = "".join(
        f'<body name="b{i}" pos="{0.2 * i} 0 1"><freejoint/>'
        f'<geom name="b{i}" type="box" size=".1 .1 .1" mass="{1 + i}" contype="0"/></body>'
        for i in range(count)
    )
    pairs = [(i, j) for i in range(count) for j in (i + 1, i + 2) if j < count]
    return bodies, "<equality>" + "".join(relation.format(f"b{i}", f"b{j}") for i, j in pairs) + "</equality>"


WELD = '<weld body1="{}" body2="{}"/>'


@pytest.mark.parametrize("law", [Moreau(0.5), Newton(1.0)])
def test_welded_boxes_collide_like_one_body(law):
    """A redundant chain of welds is hit at one end; the same boxes as a single body give the answer."""
    pin = '<body name="pin" pos="-.03 .05 .85"><freejoint/><geom name="pin" size=".05" mass="0.7"/></body>'
    bodies, equality = welded(4, WELD)
    model, data = compiled(pin + bodies, equality)
    data.qvel[2] = 3.0
    impact = law.resolve(Collision.from_mujoco(model, data))
    assert impact.collision.labels == ("b0/pin",) or impact.collision.labels == ("pin/b0",)
    geoms = "".join(
        f'<geom type="box" name="b{i}" pos="{0.2 * i} 0 0" size=".1 .1 .1" mass="{1 + i}" contype="0"/>'
        for i in range(4)
    )
    model, data = compiled(pin + f'<body pos="0 0 1"><freejoint/>{geoms}</body>')
    data.qvel[2] = 3.0
    single = law.resolve(Collision.from_mujoco(model, data))
    assert impact.impulse == pytest.approx(single.impulse, rel=1e-10)
    np.testing.assert_allclose(impact.post_velocity[:6], single.post_velocity[:6], atol=1e-10)
    np.testing.assert_allclose(impact.post_velocity[6:12], single.post_velocity[6:12], atol=1e-10)
    v, spin = single.post_velocity[6:9], single.post_velocity[9:]
    np.testing.assert_allclose(impact.post_velocity[-6:-3], v + np.cross(spin, [0.6, 0.0, 0.0]), atol=1e-10)
    assert impact.energy_change == pytest.approx(single.energy_change, rel=1e-9)


def four_bar(crank=0.4, coupler=1.5):
    """Return two upright cranks of length 1 with a coupler that can only translate: a parallelogram."""
    rod = f'<geom type="capsule" fromto="0 0 0 0 0 1" size=".02" mass="{crank}" contype="0" conaffinity="0"/>'
    hinge = '<joint axis="0 1 0"/>'
    world = f"""
        <body pos="0 0 0">{hinge}{rod}
          <body name="coupler" pos="0 0 1">{hinge}
            <geom name="coupler" type="capsule" fromto="0 0 0 2 0 0" size=".03" mass="{coupler}"/></body></body>
        <body name="crank" pos="2 0 0">{hinge}{rod}</body>
        <body name="ball" pos="-.135 0 1">
          <joint type="slide" axis="1 0 0"/><geom name="ball" size=".1" mass="0.8"/></body>
    """
    return compiled(world, '<equality><connect body1="coupler" body2="crank" anchor="2 0 0"/></equality>')


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_a_four_bar_linkage_has_one_effective_mass(e, contact_model):
    """A ball hits the end of the coupler along its axis: the linkage acts as a mass of coupler + 2 I / l^2."""
    model, data = four_bar()
    update_positions(model, data)
    crank = model.body_inertia[1][1] + model.body_mass[1] * model.body_ipos[1][2] ** 2
    effective, m, v = model.body("coupler").mass[0] + 2 * crank, 0.8, 2.0
    data.qvel[-1] = v
    (event,) = run(Stepper(model, Newton(e), contact_model=contact_model), data, 5)[:1]
    impulse = (1 + e) * v * m * effective / (m + effective)
    assert event.impact.impulse == pytest.approx([impulse], rel=1e-6)
    after = event.impact.post_velocity
    assert after[-1] == pytest.approx(v - impulse / m, rel=1e-6)
    np.testing.assert_allclose(after[:3], np.array([1.0, -1.0, 1.0]) * impulse / effective, rtol=1e-6, atol=1e-9)
    c = event.impact.collision
    np.testing.assert_allclose(c.bilateral_jacobian @ (after - c.pre_velocity), 0.0, atol=1e-12)


SLIDE = '<body pos="{1}"><joint name="{0}" type="slide" axis="1 0 0"/><geom name="{0}" size=".1" mass="{2}"/></body>'
GEARS = SLIDE.format("first", "0 0 0", 1) + SLIDE.format("second", "0 5 0", 2) + SLIDE.format("ball", "-.2 0 0", 3)


@pytest.mark.parametrize(
    ("rest", "ratio"),
    [
        ('<equality><joint joint1="second" joint2="first" polycoef="0 -1.5 0 0 0"/></equality>', -1.5),
        (
            '<tendon><fixed name="rope"><joint joint="first" coef="1"/><joint joint="second" coef="0.5"/></fixed>'
            "</tendon>"
            '<equality><tendon tendon1="rope"/><tendon tendon1="rope" polycoef="0 1 0 0 0"/></equality>',
            -2.0,
        ),
    ],
    ids=["joint", "tendon"],
)
def test_a_gear_adds_the_square_of_its_ratio(rest, ratio):
    model, data = compiled(GEARS, rest)
    data.qvel[2] = 1.0
    impact = Moreau(1.0).resolve(Collision.from_mujoco(model, data))
    effective = 1.0 + ratio**2 * 2.0
    impulse = 2.0 * 3.0 * effective / (3.0 + effective)
    np.testing.assert_allclose(impact.impulse, [impulse])
    np.testing.assert_allclose(
        impact.post_velocity, [impulse / effective, ratio * impulse / effective, 1 - impulse / 3]
    )
    assert impact.energy_change == pytest.approx(0.0, abs=1e-14)
    assert impact.residual < 1e-14


def test_constraints_that_are_off_take_no_part():
    model, data = compiled(GEARS, '<equality><joint joint1="second" joint2="first" polycoef="0 2 0 0 0"/></equality>')
    data.qvel[2] = 1.0
    data.eq_active[0] = 0
    np.testing.assert_allclose(Moreau(1.0).resolve(Collision.from_mujoco(model, data)).post_velocity, [1.5, 0.0, 0.5])
    stepper = Stepper(model, Moreau(1.0))
    stepper.step(data)
    np.testing.assert_allclose(data.qvel, [1.5, 0.0, 0.5])


def test_a_constraint_switched_on_at_rest_counts_from_the_next_step():
    """The balls touch at rest; then the gear engages and a blow follows: the last step's contacts are not reused."""
    model, data = compiled(GEARS, '<equality><joint joint1="second" joint2="first" polycoef="0 2 0 0 0"/></equality>')
    data.eq_active[0] = 0
    stepper = Stepper(model, Moreau(1.0))
    run(stepper, data, 2)
    data.eq_active[0] = 1
    data.qvel[2] = 1.0
    stepper.step(data)
    impulse = 2.0 * 3.0 * 9.0 / 12.0
    np.testing.assert_allclose(stepper.events[0].impact.impulse, [impulse])


def test_a_servo_that_holds_a_body_to_a_mocap_body_may_give_way():
    hand = '<body name="hand" pos="0 0 .3"><freejoint/><geom size=".1"/></body>'
    world = FLOOR + '<body name="target" mocap="true" pos="0 0 .3"/>' + hand
    model, data = compiled(world, '<equality><weld body1="target" body2="hand"/></equality>')
    data.mocap_pos[0, 2] = -0.2
    events = run(Stepper(model, Newton(0.5)), data, 400)
    assert events
    assert events[0].impact.collision.bilateral_jacobian is None
    assert data.qpos[2] >= 0.1 - 1e-9


def test_a_body_that_constraints_hold_cannot_bounce():
    """The ball is welded to the world and driven into the floor by its initial velocity."""
    world = FLOOR + '<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".1"/></body>'
    model, data = compiled(world, '<equality><weld body1="ball"/></equality>')
    data.qvel[2] = -1.0
    with pytest.raises(UnsolvableLawError, match="floor/ball"):
        Stepper(model, Newton(0.5), on_unsolved="raise").step(data)
    stepper = Stepper(model, Newton(0.5))
    stepper.step(data)
    assert stepper.unlocated == 1
    assert np.abs(data.qvel).max() < 1.0


@pytest.mark.parametrize(("integrator", "trembling"), [("Euler", 0.0), ("RK4", 0.0), ("implicitfast", 1e-3)])
def test_welded_boxes_rest_on_the_floor(integrator, trembling):
    """MuJoCo's welds are soft; redundant ones tremble under implicitfast, and so do boxes on the floor."""
    bodies, equality = welded(3, WELD)
    bodies = (
        bodies.replace(' 0 1"', ' 0 .1"')
        .replace('contype="0"', 'contype="1"')
        .replace("<geom ", '<geom conaffinity="2" ')
    )
    floor = FLOOR.replace("/>", ' contype="2"/>')
    model, data = compiled(floor + bodies, equality, option=f'timestep="0.002" integrator="{integrator}"')
    stepper = Stepper(model, Moreau(0.5))
    events = run(stepper, data, 1000)
    assert all(np.abs(event.impact.collision.pre_contact_velocity).max() < trembling for event in events)
    assert np.abs(data.qvel).max() < max(trembling, 1e-9)
    assert data.qpos[2::7] == pytest.approx([0.1] * 3, abs=1e-6 if trembling else 2e-9)


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_every_collision_of_a_falling_linkage_keeps_its_constraints(contact_model):
    """Three boxes joined by ball joints fall tilted and tumble: J_eq v+ = J_eq v-, and no energy is created."""
    bodies, equality = welded(3, '<connect body1="{}" body2="{}" anchor=".1 0 0"/>')
    bodies = bodies.replace('contype="0"', 'contype="1" conaffinity="2"').replace(' 0 1"', ' 0 .5"')
    equality = equality.replace('<connect body1="b0" body2="b2" anchor=".1 0 0"/>', "")
    floor = FLOOR.replace("/>", ' contype="2"/>')
    model, data = compiled(floor + bodies, equality, option='timestep="0.002"')
    data.qvel[3:6] = 0.5, 1.0, 0.2
    data.qvel[9:12] = data.qvel[15:18] = data.qvel[3:6]
    events = run(Stepper(model, Newton(0.3), contact_model=contact_model), data, 400)
    assert len(events) > 3
    for event in events:
        c = event.impact.collision
        assert c.bilateral_jacobian.shape == (6, 18)
        jump = c.bilateral_jacobian @ (event.impact.post_velocity - c.pre_velocity)
        assert np.abs(jump).max() < 1e-9
        assert event.impact.residual < 1e-9
        assert event.impact.violations.is_admissible()


@pytest.mark.parametrize("drift", [1e-5, 1e-3])
def test_redundant_constraints_that_have_drifted_lock_nothing(drift):
    """MuJoCo's soft welds let boxes move by a part of their size: the redundant welds still count as redundant."""
    pin = '<body name="pin" pos="-.03 .05 .8"><freejoint/><geom name="pin" size=".05" mass="0.7"/></body>'
    bodies, equality = welded(5, WELD)
    chain = "<equality>" + "".join(WELD.format(f"b{i}", f"b{i + 1}") for i in range(4)) + "</equality>"
    model, data = compiled(pin + bodies, equality)
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, np.append(np.zeros(6), drift * rng.normal(size=30)), 1.0)
    update_positions(model, data)
    data.qpos[2] += _gap(model, data)
    data.qvel[2] = 3.0
    impact = Moreau(0.5).resolve(Collision.from_mujoco(model, data))
    assert impact.collision.bilateral_jacobian.shape == (24, 36)
    other, same = compiled(pin + bodies, chain)
    same.qpos[:], same.qvel[:] = data.qpos, data.qvel
    single = Moreau(0.5).resolve(Collision.from_mujoco(other, same))
    assert impact.impulse == pytest.approx(single.impulse, rel=10 * drift)


def _gap(model, data):
    from impactlaw import read_contacts

    return read_contacts(model, data, within=0.1).gap.min()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"scheme": "time-stepping"},
        {"contact_model": "soft"},
        {"contact_model": "soft", "compiled": "never"},
    ],
    ids=str,
)
def test_a_weld_between_bodies_that_stand_still_does_nothing(options):
    """MuJoCo reserves Jacobian rows for the weld, but creates none."""
    balls = "".join(f'<body pos="{x} 0 1"><freejoint/><geom size=".1" mass="1"/></body>' for x in (0.0, 0.2))
    posts = '<body name="a" pos="1 0 0"><geom size=".1"/></body><body name="b" pos="2 0 0"><geom size=".1"/></body>'
    model, data = compiled(balls + posts, "<equality>" + WELD.format("a", "b") + "</equality>", option=EULER)
    data.qvel[0] = 1.0
    assert Collision.from_mujoco(model, data).jacobian.shape == (1, 12)
    stepper = Stepper(model, Moreau(0.5), **options)
    stepper.step(data)
    stepper.step(data)
    assert data.qvel[[0, 6]] == pytest.approx([0.25, 0.75], abs=1e-9)


LEVER = """<mujoco><option timestep=".001" gravity="0 0 0"><flag contact="disable"/></option><worldbody>
  <body><joint name="knee" axis="0 1 0" damping=".5"/><geom size=".1" pos=".5 0 0" mass="2"/></body>
  <body pos="2 0 0"><joint name="cap" axis="0 1 0" damping=".1"/><geom size=".1" pos=".1 0 0" mass="1"/></body>
  <body pos="4 0 0"><joint name="slide" type="slide" axis="1 0 0" range="0 1"/><geom size=".05" mass=".1"/></body>
  </worldbody><equality><joint joint1="slide" joint2="knee" polycoef="0 {slope} 0 0 0"/>
  <joint joint1="cap" joint2="knee" polycoef="{off} 1 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("slope", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("off", [0.03, -0.03])
def test_constraints_give_way_beside_a_held_limit_as_in_time_stepping(slope, off):
    """The knee drives a light slide into its limit while another constraint recovers from its drift."""
    model = mujoco.MjModel.from_xml_string(LEVER.format(slope=slope, off=off))
    ends = []
    for options in ({}, {"scheme": "time-stepping"}):
        stepper, data = Stepper(model, Moreau(0.0), **options), mujoco.MjData(model)
        data.qvel[:] = -0.5, -0.5, 0.0
        for _ in range(100):
            stepper.step(data)
        assert stepper.unlocated == stepper.short_steps == 0
        ends.append(np.concatenate([data.qpos, 0.1 * data.qvel]))
    np.testing.assert_allclose(ends[0], ends[1], atol=5e-4)


SLIPPING = """<mujoco><compiler angle="radian"/><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body><joint name="knee" axis="0 1 0" range="0 1"/><geom size=".1" pos="0 0 -.4" mass="1"/>
    <body pos="0 0 -.4"><joint name="slip" type="slide" axis="1 0 0" range="0 .1" armature=".01"/>
      <geom size=".1" mass=".1"/></body></body></worldbody>
  <equality><joint joint1="slip" joint2="knee" polycoef="0 .003 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("way", scenes.WAYS)
def test_limit_that_a_slow_drift_of_a_constraint_closes_does_not_drive_the_rest(way):
    """A slip of 3 mm per radian drifts into its limit at 0.05 m/s; to reverse it, the knee would turn at 32 rad/s."""
    model = mujoco.MjModel.from_xml_string(SLIPPING)
    data = mujoco.MjData(model)
    data.qvel[:] = -1.0, -0.05
    stepper = Stepper(model, Moreau(1.0), **scenes.WAYS[way])
    for _ in range(5):
        stepper.step(data)
        assert abs(data.qvel[0]) < 1.1
