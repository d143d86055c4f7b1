"""Cylinders and capsules that touch along a line: pucks leave each other parallel, and piles of pipes come to rest."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Newton, Stepper, read_contacts
from impactlaw.scene.pairs import some_side_by_side
from impactlaw.scene.tolerances import GAP_TOLERANCE, SKIN

SCENE = """<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 {gravity}"/>
  <default><geom friction="0"/></default><worldbody>{floor}
  <body pos="{x} {y} .02" euler="0 0 {yaw}"><freejoint/>
    <geom name="one" type="cylinder" size=".04 .02" mass=".2"/></body>
  <body pos="0 0 {height}"><freejoint/><geom name="other" type="{kind}" size=".04 .02" mass=".2"/></body>
  </worldbody></mujoco>"""
ICE = '<geom name="ice" type="plane" size="9 9 1"/>'
WAYS = {
    "event-driven": {"scheme": "event-driven"},
    "time-stepping": {"scheme": "time-stepping"},
    "asked in Python": {"scheme": "time-stepping", "compiled": "never"},
}
ways = pytest.mark.parametrize("way", ["event-driven", "time-stepping"])


def thrown(angle, law, way, *, floor="", height=0.02, kind="cylinder"):
    """Return data after a cylinder was thrown at another one at 1 m/s, at an angle in degrees, and the direction."""
    out = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    (x, y, _), gravity = -0.1 * out, -9.81 if floor else 0.0
    scene = SCENE.format(floor=floor, gravity=gravity, x=x, y=y, yaw=3 * angle, height=height, kind=kind)
    model = mujoco.MjModel.from_xml_string(scene)
    data, collisions = mujoco.MjData(model), 0
    data.qvel[:3] = out
    stepper = Stepper(model, law, **WAYS[way])
    for _ in range(40):
        stepper.step(data)
        collisions += sum("one/other" in event.contacts.labels for event in stepper.events)
    assert collisions == 1
    assert stepper.short_steps == stepper.unlocated == 0
    return data, out


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("angle", [0.0, 23.0, 100.0, -140.0])
def test_pucks_of_one_height_do_not_tip(angle, way):
    data, out = thrown(angle, Newton({("one", "other"): 0.8}, default=0.0), way, floor=ICE)
    np.testing.assert_allclose(data.qvel[:3], 0.1 * out, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(data.qvel[6:9], 0.9 * out, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(data.qvel[[3, 4, 9, 10]], 0.0, rtol=0.0, atol=1e-9)


@ways
@pytest.mark.parametrize("size", [".06 .0005", ".15 .0005"])
def test_thin_disks_of_one_height_hit_once_and_do_not_tip(size, way):
    """Their rims touch along a line of less than a percent of their radii."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option integrator="RK4"/>
        <default><geom type="cylinder" size="{size}" mass=".1" friction="0"/></default>
        <worldbody><geom type="plane" size="9 9 1"/><body pos="0 0 .0005"><freejoint/><geom/></body>
        <body pos="{2 * float(size.split()[0]) + 0.01} 0 .0005" euler="0 0 20"><freejoint/><geom/></body>
        </worldbody></mujoco>"""
    )
    data, collisions = mujoco.MjData(model), 0
    data.qvel[6] = -1.0
    stepper = Stepper(model, Moreau(1.0), **WAYS[way])
    for _ in range(20):
        stepper.step(data)
        collisions += len(stepper.events)
    assert collisions == 1
    np.testing.assert_allclose(data.qvel, [-1.0] + 11 * [0.0], rtol=0.0, atol=1e-7)


@ways
@pytest.mark.parametrize("height", [0.03, 0.005])
def test_cylinders_that_are_shifted_along_their_axes_turn_alike(height, way):
    """The whole line of contact then opens with e times the speed at which it closed."""
    (data, _), e = thrown(0.0, Moreau(0.5), way, height=height), 0.5
    shift, inertia = 0.5 * (height - 0.02), 0.2 * (3 * 0.04**2 + 0.04**2) / 12
    impulse = (1 + e) / (2 / 0.2 + 2 * shift**2 / inertia)
    np.testing.assert_allclose(data.qvel[[0, 6]], [1 - impulse / 0.2, impulse / 0.2], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(data.qvel[[4, 10]], -shift * impulse / inertia, rtol=1e-9)


@ways
def test_a_cylinder_beside_a_capsule(way):
    data, _ = thrown(0.0, Moreau(0.5), way, kind="capsule")
    np.testing.assert_allclose(data.qvel[[0, 6]], [0.25, 0.75], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(data.qvel[[4, 10]], 0.0, atol=1e-6)


BESIDE = """<mujoco><option ccd_tolerance="1e-12" ccd_iterations="200"/><worldbody>
  <geom name="one" type="{first}" size="{r1} {l1}" margin="0.1"/>
  <body pos="{x} {y} {z}"><freejoint/><geom name="other" type="{kind}" size="{r2} {l2}" zaxis="{turn}"/></body>
  </worldbody></mujoco>"""


@pytest.mark.parametrize("seed", range(60))
def test_the_smaller_gap_of_both_ends_is_the_distance(seed):
    """MuJoCo measures the distance of single bodies to 1e-12 m here; the normal of an end is exact to first order."""
    rng = np.random.default_rng(seed)
    (r1, r2), (l1, l2), angle = rng.uniform(0.02, 0.1, 2), rng.uniform(0.05, 0.4, 2), 10.0 ** rng.uniform(-6, -2.2)
    tilt, way = rng.normal(size=2) * angle / 2, rng.uniform(0.0, 2 * np.pi)
    far = r1 + r2 + 1e-4 + np.hypot(*tilt) * (l1 + l2)
    model = mujoco.MjModel.from_xml_string(
        BESIDE.format(
            r1=r1, l1=l1, r2=r2, l2=l2, turn=f"{tilt[0]} {tilt[1]} 1",
            first=("cylinder", "capsule")[seed % 3 == 2], kind=("cylinder", "capsule")[seed % 3 > 0],
            x=far * np.cos(way), y=far * np.sin(way), z=rng.uniform(-0.5, 0.5) * (l1 + l2),
        )
    )  # fmt: skip
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    contacts = read_contacts(model, data, within=0.1)
    skin = 0.0 if seed % 3 else SKIN  # see there
    assert contacts.labels == ("one/other", "one/other")
    assert contacts.gap.min() == pytest.approx(data.contact.dist.min() - skin, abs=1e-9)
    assert contacts.normal[0] == pytest.approx(contacts.normal[1], abs=10 * angle if data.ncon > 1 else 0.0)


def test_cylinders_on_top_of_each_other_or_across_have_no_line():
    for x, z, turn in ((0.001, 0.3999, "0 0 1"), (0.1001, 0.0, "0 1 1"), (0.0707, 0.39999, "0 0 1")):
        scene = BESIDE.format(
            first="cylinder", kind="cylinder", r1=0.05, l1=0.2, r2=0.05, l2=0.2, turn=turn, x=x, y=0, z=z
        )
        model = mujoco.MjModel.from_xml_string(scene)
        normal = read_contacts(model, mujoco.MjData(model), within=1e-3).normal
        assert (np.abs(normal[:, 2]) > 0.99).all() if turn == "0 0 1" else len(normal) == 1


TROUGH = """<mujoco><option timestep="0.002" integrator="RK4"/><default><geom friction="0.6"/></default><worldbody>
  <geom type="plane" size="9 9 1"/><geom type="box" size=".02 1 .1" pos="-.125 0 .1"/>
  <geom type="box" size=".02 1 .1" pos=".125 0 .1"/>
  <body pos="-.0505 0 .05" euler="90 0 0"><freejoint/><geom type="cylinder" size=".05 .3" mass="2"/></body>
  <body pos=".0505 0 .05" euler="90 0 0"><freejoint/><geom type="{kind}" size=".05 .3" mass="2"/></body>
  <body pos="0 .05 .14" euler="90 0 0"><freejoint/><geom type="cylinder" size=".05 .2" mass="2"/></body>
  </worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("way", "kind", "e"),
    [("event-driven", "cylinder", 0.0)]
    + [("time-stepping", kind, e) for kind in ("cylinder", "capsule") for e in (0.0, 0.3)],
)
def test_pipes_in_a_trough_come_to_rest(way, kind, e):
    model = mujoco.MjModel.from_xml_string(TROUGH.format(kind=kind))
    data, collisions, energy = mujoco.MjData(model), [], []
    stepper = Stepper(model, Moreau(e), **WAYS[way])
    for _ in range(300):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        collisions.append(stepper.sums.collisions)
        energy.append(data.energy.sum())
    assert sum(collisions[150:]) == 0
    assert np.diff(energy).max() < 2e-5
    assert stepper.short_steps == stepper.unlocated == 0
    assert np.abs(data.qvel).max() < 1e-9


def test_capsules_that_are_not_quite_parallel_come_to_rest():
    """MuJoCo's one point jumps from end to end of the line, which gives energy to the capsules."""
    model = mujoco.MjModel.from_xml_string(TROUGH.format(kind="capsule").replace('"cylinder"', '"capsule"'))
    data, rng, energy = mujoco.MjData(model), np.random.default_rng(0), []
    for k in range(3):
        data.qpos[7 * k + 2] += 0.001 * (1 + k)
        mujoco.mju_quatIntegrate(data.qpos[7 * k + 3 : 7 * k + 7], rng.normal(size=3) * [1e-3, 0.0, 1e-3], 1.0)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(300):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energy.append(data.energy.sum())
    assert np.diff(energy).max() < 1e-7
    assert stepper.sums.collisions == stepper.short_steps == 0
    assert np.abs(data.qvel).max() < 1e-3  # they can roll slowly


TURNING = """<mujoco><option timestep="0.002" integrator="RK4"/><default><geom friction="0"/></default><worldbody>
  <geom type="cylinder" size="{r} .3" euler="0 90 0"/><body pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>
  <joint type="hinge" axis="0 0 1"/><joint type="hinge" axis="0 1 0"/>
  <geom type="{kind}" size="{r} {half}" euler="0 90 0" mass="2"/></body></worldbody></mujoco>"""


@ways
@pytest.mark.parametrize(
    ("kind", "r", "half"), [("cylinder", 0.05, 0.3), ("capsule", 0.05, 0.2), ("cylinder", 0.05, 0.01)]
)
def test_a_log_that_turns_across_another_one_stays_on_it(way, kind, r, half):
    """It passes from two contacts to one at an angle of 0.05, where it can rock on that one."""
    model = mujoco.MjModel.from_xml_string(TURNING.format(kind=kind, r=r, half=half, height=2 * r))
    data = mujoco.MjData(model)
    data.qpos[1], data.qvel[1] = -0.002, 0.1
    stepper, energy = Stepper(model, Moreau(0.3), **WAYS[way]), []
    for _ in range(400):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energy.append(data.energy.sum())
        assert stepper.sums.collisions == 0
    assert stepper.short_steps == stepper.unlocated == 0
    np.testing.assert_allclose(energy, energy[0], rtol=0.0, atol=2.0 * 9.81 * SKIN)
    assert (np.abs(data.qpos - [0.0, 0.078, 0.0]) < [SKIN + GAP_TOLERANCE, 1e-4, 2e-4]).all()


@ways
def test_a_log_rolls_down_another_one_without_collisions(way):
    """Regression: steps were counted as short, since MuJoCo's distance of parallel cylinders is wrong near 0."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001" integrator="RK4"/><default><geom type="cylinder" friction="3"/></default>
        <worldbody><geom size="1 .5" euler="90 0 0"/><body pos="{1.1 * np.sin(0.2)} 0 {1.1 * np.cos(0.2)}"><freejoint/>
        <geom size=".1 .3" euler="90 0 0"/></body></worldbody></mujoco>"""
    )
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.0), **WAYS[way])
    for _ in range(500):
        stepper.step(data)
        assert abs(np.hypot(data.qpos[0], data.qpos[2]) - 1.1) < 2e-6
    turned = np.cos(0.2) - data.qpos[2] / 1.1
    np.testing.assert_allclose(np.linalg.norm(data.qvel[:3]), np.sqrt(4.0 / 3.0 * 9.81 * 1.1 * turned), rtol=1e-4)
    assert stepper.short_steps == stepper.unlocated == 0


@ways
def test_masks_can_be_set_later(way):
    """A line of contact has its impulse in the middle, also if geoms could not collide when the stepper was made."""
    scene = SCENE.format(floor=ICE, gravity=0, x=-0.1, y=0, yaw=0, height=0.02, kind="cylinder")
    model = mujoco.MjModel.from_xml_string(scene)
    data, masks = mujoco.MjData(model), model.geom_conaffinity.copy()
    model.geom_conaffinity[1:] = 0
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    model.geom_conaffinity[:] = masks
    data.qvel[0] = 1.0
    for _ in range(40):
        stepper.step(data)
    np.testing.assert_allclose(data.qvel[[0, 6, 4, 10]], [0.25, 0.75, 0.0, 0.0], rtol=0.0, atol=1e-9)


def test_only_scenes_with_two_cylinders_or_capsules_are_looked_at():
    for kinds, meet in {
        ("cylinder", "cylinder"): True,
        ("cylinder", "capsule"): True,
        ("capsule", "capsule"): True,
        ("cylinder", "sphere"): False,
    }.items():
        bodies = "".join(f'<body><freejoint/><geom type="{kind}" size=".1 .1"/></body>' for kind in kinds)
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
        assert some_side_by_side(model) == meet
