"""Touching bodies that equality constraints tie to each other: their contact can only act against the constraint."""

import mujoco
import numpy as np
import pytest
from scenes import WAYS

from impactlaw import Moreau, Stepper

PAIR = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body name="a"><freejoint/><geom type="{shape}" size=".1 .05 .05" mass=".5"/></body>
  <body name="b" pos=".2 0 0"><freejoint/><geom type="{shape}" size=".1 .05 .05" mass=".5"/></body>
  </worldbody><equality>{equality}</equality></mujoco>"""
BRICKS = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="a" pos="0 0 .6" euler="30 20 0"><freejoint/><geom type="box" size=".1 .05 .05" mass=".5"/></body>
  <body name="b" pos="{place}" euler="30 20 0"><freejoint/><geom type="box" size=".1 .05 .05" mass=".5"/></body>
  </worldbody><equality>{equality}</equality></mujoco>"""
HINGE = '<connect body1="a" body2="b" anchor=".1 0 .05"/><connect body1="a" body2="b" anchor=".1 0 -.05"/>'
TIES = {
    "weld": '<weld body1="a" body2="b"/>',
    "connect": '<connect body1="a" body2="b" anchor=".1 0 0"/>',
    "hinge": HINGE,
}


def kinetic_energy(model, data):
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return 0.5 * data.qvel @ mass @ data.qvel


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("tie", TIES)
@pytest.mark.parametrize("shape", ["box", "sphere"])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_no_energy_comes_from_contact_between_tied_bodies(way, tie, shape, e):
    model = mujoco.MjModel.from_xml_string(PAIR.format(shape=shape, equality=TIES[tie]))
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(e), on_inadmissible="project", **WAYS[way])
    data.qvel[6:] = -0.1, 0.05, 0.0, 0.2, 0.5, 0.3  # violates every tie
    mujoco.mj_forward(model, data)
    begin, momentum = kinetic_energy(model, data), data.qvel[:3] + data.qvel[6:9]
    for _ in range(300):
        stepper.step(data)
        assert kinetic_energy(model, data) < 1.01 * begin
    np.testing.assert_allclose(data.qvel[:3] + data.qvel[6:9], momentum, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("tie", TIES)
def test_bricks_that_are_tied_fall_and_come_to_rest(way, tie):
    axis, equality = np.zeros(9), TIES[tie]
    quat = mujoco.MjModel.from_xml_string(BRICKS.format(place="9 9 9", equality=equality)).body("b").quat
    mujoco.mju_quat2Mat(axis, quat)
    place = np.array([0.0, 0.0, 0.6]) + 0.2 * axis.reshape(3, 3)[:, 0]
    model = mujoco.MjModel.from_xml_string(BRICKS.format(place=" ".join(map(str, place)), equality=equality))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), on_inadmissible="project", **WAYS[way])
    fastest = 0.0
    for _ in range(1500):
        stepper.step(data)
        fastest = max(fastest, np.linalg.norm(data.qvel[:3]))
    assert fastest < 4.0  # a fall of .6 m ends with 3.4 m/s
    assert np.abs(data.qvel).max() < 0.05


@pytest.mark.parametrize(
    ("tie", "e", "turned"),
    [
        ("hinge", 0.5, "65 87 82"),
        ("hinge", 0.2, "-11 82 0"),
        ("hinge", 0.9, "17 -29 -20"),
        ("connect", 0.9, "-58 65 7"),
        ("hinge", 0.2, "25 -41 -83"),
        ("hinge", 0.9, "-63 -83 -3"),
        ("hinge", 0.9, "68 -34 -5"),
        ("hinge", 0.2, "58 -78 33"),
    ],
)
def test_contacts_that_a_hinge_jams_together_gain_no_energy(tie, e, turned):
    """Each contact can open, but only if another one closes: impulses of a ton times metres per second cancel."""
    bricks, axis = BRICKS.replace("30 20 0", turned), np.zeros(9)
    quat = mujoco.MjModel.from_xml_string(bricks.format(place="9 9 9", equality=TIES[tie])).body("b").quat
    mujoco.mju_quat2Mat(axis, quat)
    place = np.array([0.0, 0.0, 0.6]) + 0.2 * axis.reshape(3, 3)[:, 0]
    model = mujoco.MjModel.from_xml_string(bricks.format(place=" ".join(map(str, place)), equality=TIES[tie]))
    data = mujoco.MjData(model)
    stepper, energy = Stepper(model, Moreau(e), scheme="time-stepping", on_inadmissible="project"), []
    for _ in range(800):
        stepper.step(data)
        energy.append(kinetic_energy(model, data) + 0.5 * 9.81 * (data.qpos[2] + data.qpos[9]))
    assert np.diff(energy).max() < 0.05


BASE = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body pos="0 0 1"><joint type="slide" axis="0 0 1" damping="{damping}"/>
    <joint type="slide" axis="1 0 0" damping="{damping}"/>
    <geom size=".1" mass="50" contype="0" conaffinity="0"/>
    <body><joint axis="0 1 0" armature="1" damping="10"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".04" mass="2" contype="0" conaffinity="0"/>
      <body pos=".4 0 0"><joint axis="0 1 0" armature="1" damping="10"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".04" mass="2"/></body></body></body>
  <body pos=".6 0 1.1"><freejoint/><geom size=".05" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("damping", [1e7, 1e9, 1e11])
@pytest.mark.parametrize("way", WAYS)
def test_a_base_that_damping_locks_stays_where_it_is(way, damping):
    """Fetch's base is held by 1e11 N s/m: if a collision moved it, damping would react with a huge force."""
    model = mujoco.MjModel.from_xml_string(BASE.format(damping=damping))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.0), on_inadmissible="project", **WAYS[way])
    data.qvel[6] = -2.0
    hit = False
    for _ in range(100):
        stepper.step(data)
        hit = hit or abs(data.qvel[3]) > 0.05
        assert np.abs(data.qvel).max() < 5.0
    assert hit
    assert np.abs(data.qpos[:2]).max() < 1e-4


THROWN = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="a" pos="0 0 .5"><freejoint/><geom type="box" size=".1 .05 .05" mass=".5"/></body>
  <body name="b" pos=".2 0 .5"><freejoint/><geom type="box" size=".1 .05 .05" mass=".5"/></body>
  </worldbody><equality><weld body1="a" body2="b"/></equality></mujoco>"""


@pytest.mark.parametrize("way", ["time-stepping", "event-driven"])
def test_glued_bricks_that_fall_askew_come_to_rest(way):
    """If only constraints give way, time stepping ends at 44 m/s or rad/s."""
    model = mujoco.MjModel.from_xml_string(THROWN)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), on_inadmissible="project", **WAYS[way])
    quat, place = np.random.default_rng(0).normal(size=4), np.zeros(3)
    quat /= np.linalg.norm(quat)
    mujoco.mju_rotVecQuat(place, np.array([0.2, 0.0, 0.0]), quat)
    place[2] += 0.5
    data.qpos[:7], data.qpos[7:] = [0.0, 0.0, 0.5, *quat], [*place, *quat]
    for _ in range(1500):
        stepper.step(data)
        assert np.abs(data.qvel).max() < 40.0
    assert np.abs(data.qvel).max() < 0.1


LOOSE = """<mujoco><option timestep=".005"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="beam" pos="0 0 .4"><freejoint align="false"/>
    <geom type="box" size=".5 .05 .05" pos=".5 0 0" mass="1"/></body></worldbody>
  <equality><weld body1="beam" torquescale="{}"/></equality></mujoco>"""


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scale", [0.001, 0.1])
def test_a_beam_that_a_weld_hardly_turns_falls_onto_the_floor_and_stays_there(way, scale):
    """Its weld acts as a joint with a weak spring: taken for a tie of beam and floor, it would let the beam through."""
    model = mujoco.MjModel.from_xml_string(LOOSE.format(scale))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), on_inadmissible="project", **WAYS[way])
    data.qvel[4] = 3.0
    lowest, fastest = 0.0, 0.0
    for _ in range(400):
        stepper.step(data)
        lowest = min(lowest, data.contact.dist.min(initial=0.0))
        fastest = max(fastest, np.abs(data.qvel).max())
    assert data.time == pytest.approx(2.0)
    assert lowest > -0.02
    assert fastest < 8.0


def link(end: str, inner: str) -> str:
    return f"""<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 {end}" size=".02" mass=".2"/>{inner}"""


def leg(x: float, side: float, site: str) -> str:
    last = link(f"{side} 0 .1", f'<site name="{site}" pos="{side} 0 .1"/>')
    shin = f'<body pos="0 0 .3">{last}</body>'
    return f'<body pos="{x} 0 0">{link("0 0 .3", shin)}</body>'


FIVE_BARS = f"""<mujoco><option timestep=".002"><flag energy="enable"/></option><worldbody>
  <geom type="plane" size="9 9 1"/><body pos="0 0 .5"><freejoint/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".2"/>{leg(0.3, -0.15, "a")}{leg(0.0, 0.15, "b")}</body>
  </worldbody><equality><connect site1="a" site2="b"/></equality></mujoco>"""


@pytest.mark.parametrize("pushed", [0.0, 1e-9, 2e-9, 3e-9, 4e-9])
@pytest.mark.parametrize("way", ["time-stepping", "soft", "soft in Python"])
def test_a_loop_of_five_bars_that_falls_gains_no_energy(way, pushed):
    """All its axes are parallel: one row of its connect depends on the others, up to the drift of the connect.

    A tiny push makes it fall in another way, because the result of a single fall may be luck.
    """
    model = mujoco.MjModel.from_xml_string(FIVE_BARS)
    data, stepper, energy = mujoco.MjData(model), Stepper(model, Moreau(0.9), **WAYS[way]), []
    data.qvel[:6] = pushed, 0.0, -1.0, 0.5, 1.0, 0.3
    for _ in range(2000):
        stepper.step(data)
        energy.append(data.energy.sum())
    assert np.diff(energy).max() < 0.2


# each gained 0.2 to 1.3 J in the step that starts here
DRIFTED = [
    "0.6294 -0.3715 0.0364 0.568 -0.6396 -0.3846 0.3471 -1.3594 1.1843 -1.4949 1.411"
    " 0.2902 -0.2849 0.261 -11.008 -1.9641 -2.4624 3.0135 -3.2229 3.2326 -2.374",
    "0.6763 -0.2286 0.0276 -0.01 0.0023 -0.6889 0.7248 -0.4155 1.2282 0.215 -0.7079"
    " -0.3854 0.0804 0.6855 1.4426 -0.5005 11.9949 3.4371 -11.9188 -1.4221 0.5263",
    "0.3082 -0.2339 0.3177 0.8388 -0.0042 0.5256 0.1422 -0.4307 1.2574 0.4442 -1.3154"
    " 1.1345 -0.1726 -1.2316 -2.5676 -3.1855 -0.655 -5.759 -2.0586 11.8611 -46.6134",
    "0.5298 -0.4339 0.0302 0.5012 -0.3561 -0.4459 0.6506 -0.3363 -1.428 0.2681 1.5939"
    " 0.1575 0.3395 0.4696 6.0251 -2.5724 10.2581 3.4236 2.6532 -4.5496 -2.8304",
]


@pytest.mark.parametrize("state", DRIFTED)
def test_a_connect_that_has_given_way_does_not_drive_a_collision(state):
    model = mujoco.MjModel.from_xml_string(FIVE_BARS)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.9), scheme="time-stepping")
    data.qpos[:], data.qvel[:] = np.split(np.array(state.split(), float), [model.nq])
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    stepper.step(data)
    assert len(stepper.events) > 0
    assert data.energy.sum() < before + 0.1


@pytest.mark.parametrize("way", WAYS)
def test_the_floor_holds_many_bodies_that_are_welded_to_each_other(way):
    bodies = "".join(
        f'<body name="b{i}" pos="{0.07 * i} 0 .05"><freejoint/><geom size=".03" mass=".2"/></body>' for i in range(30)
    )
    welds = "".join(f'<weld body1="b{i - 1}" body2="b{i}"/>' for i in range(1, 30))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><geom type="plane" size="9 9 1"/>'
        f"{bodies}</worldbody><equality>{welds}</equality></mujoco>"
    )
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.0), **WAYS[way])
    for _ in range(100):
        stepper.step(data)
        assert data.xpos[1:, 2].min() > 0.028


ROD = """<body name="{name}{side}" pos=".2 {y} 0"><joint type="ball"/><geom type="capsule" size=".006" mass=".1"
  fromto="0 0 0 -.12 0 -.35" contype="0" conaffinity="0"/></body>"""
ARM = """<frame euler="0 0 {turn}"><frame pos=".2 0 0"><body><joint axis="0 1 0"/><geom type="capsule" size=".015"
  mass=".5" fromto="0 0 0 .2 0 0" contype="0" conaffinity="0"/>{rods}</body></frame></frame>"""


@pytest.mark.parametrize("way", WAYS)
def test_the_platform_of_a_delta_robot_bounces(way):
    arms = "".join(
        ARM.format(turn=120 * k, rods="".join(ROD.format(name=k, side=s, y=f"{s}.05") for s in "+-")) for k in range(3)
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.001" integrator="RK4"/><worldbody><geom type="plane" size="1 1 1" pos="0 0 -.4"/>'
        f'{arms}<body name="platform" pos="0 0 -.35"><freejoint/><geom type="cylinder" size=".1 .01" mass=".5"/></body>'
        "</worldbody><equality>"
        + "".join(f'<connect body1="{k}{s}" body2="platform" anchor="-.12 0 -.35"/>' for k in range(3) for s in "+-")
        + "</equality></mujoco>"
    )
    data, stepper, upwards = mujoco.MjData(model), Stepper(model, Moreau(0.8), **WAYS[way]), 0.0
    for _ in range(150):
        stepper.step(data)
        assert data.body("platform").xpos[2] > -0.392
        upwards = max(upwards, data.qvel[-4])
    assert upwards > 0.3


CHUTE = """<mujoco><option timestep="0.002" gravity="0 0 0" cone="{cone}"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <body name="a" pos="0 0 .1003"><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
    <geom size=".1" mass="1" friction="1"/></body>
  <body name="b" pos="0 0 .1003"><joint type="slide" axis="0 {side} 1"/>
    <geom size=".1" mass="1" contype="0" conaffinity="0"/></body>
  </worldbody><equality><connect body1="a" body2="b" anchor="0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_ball_that_is_led_along_an_edge_of_its_pyramid_of_friction_is_not_tied(way, side, cone):
    """The constraint does not restrict the normal, but blocks one edge of the pyramid, which is a row of MuJoCo."""
    model = mujoco.MjModel.from_xml_string(CHUTE.format(cone=cone, side=side))
    data = mujoco.MjData(model)
    data.qvel[:] = -0.4 * side, -0.4, -0.4 * np.sqrt(2.0)
    stepper, before = Stepper(model, Moreau(0.5), friction="ignore", **WAYS[way]), data.qvel.copy()
    for _ in range(10):
        stepper.step(data)
        if stepper.events:
            break
    np.testing.assert_allclose(stepper.events[0].impact.post_velocity, -0.5 * before, rtol=1e-3)


def test_compiled_soft_steps_and_those_in_python_know_the_same_contacts_as_tied():
    """Two pins close to each other join bodies that are turned: which rows are independent depends on the rank test."""
    pin = '<connect body1="a" body2="b" anchor="{}"/>'
    pins = pin.format(".0768 -.066 -.007") + pin.format(".0736 -.0717 -.0071")
    scene = PAIR.format(shape="sphere", equality=pins).replace(".1 .05 .05", ".1").replace('pos=".2', 'pos=".15')
    model, ends = mujoco.MjModel.from_xml_string(scene), []
    for how in ("auto", "never"):
        data = mujoco.MjData(model)
        data.qpos[7:] = 0.1441, -0.0075, -0.0068, 0.9994, -0.0079, -0.0229, 0.0238
        data.qvel[0], data.qvel[6] = 0.3, -0.3
        Stepper(model, Moreau(0.5), contact_model="soft", compiled=how).step(data)
        ends.append(data.qvel.copy())
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_the_tied_contact_is_meant_where_geoms_and_bodies_have_different_orders():
    """MuJoCo lists the contacts of one pair of bodies after another, `Contacts` has them in the order of geoms."""
    model = mujoco.MjModel.from_xml_string("""
    <mujoco>
      <option gravity="0 0 0"/>
      <worldbody>
        <body name="long"><freejoint/>
          <geom name="left" size=".1" pos="-.5 0 0"/><geom name="right" size=".1" pos=".5 0 0"/></body>
        <body name="welded" pos=".699 0 0"><freejoint/><geom name="end" size=".1"/></body>
        <body name="free" pos="-.699 0 0"><freejoint/><geom name="ball" size=".1"/></body>
      </worldbody>
      <equality><weld body1="long" body2="welded"/></equality>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[12] = 1.0  # the free ball hits the left end
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    stepper.step(data)
    assert [event.contacts.labels for event in stepper.events] == [("left/ball",)]
