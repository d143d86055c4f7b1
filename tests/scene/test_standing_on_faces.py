"""Cylinders that stand, slide, tip and rock on boxes and on each other, as on planes."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper, read_contacts

RADIUS, HALF, GRAVITY = 0.03, 0.06, 9.81  # a can stands on slopes up to a half
TURNS = 0.0, 0.3, 1.2, 2.0  # rad
WAYS = {"event-driven": {"integrator": "RK4"}, "time-stepping": {"integrator": "Euler"}}
FLOORS = {
    "box": '<geom type="box" size="{m} {m} {m}" pos="0 0 -{m}"/>',
    "lid": '<geom type="cylinder" size="{m} {m}" pos="0 0 -{m}" euler="180 0 0"/>',
}


def _scene(way: str, floor: str, slope: float, *, direction: float = 0.5, friction: float = 1.0, meter: float = 1.0):
    down = GRAVITY * meter * np.array([np.sin(slope) * np.cos(direction), np.sin(slope) * np.sin(direction), 0.0])
    down[2] = -GRAVITY * meter * np.cos(slope)
    bodies = "".join(
        f'<body pos="0 {0.2 * i * meter} {HALF * meter}" euler="0 0 {np.degrees(turn)}"><freejoint/>'
        f'<geom type="cylinder" size="{RADIUS * meter} {HALF * meter}" mass="1"/></body>'
        for i, turn in enumerate(TURNS)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="2e-3" integrator="{WAYS[way]["integrator"]}"
        gravity="{down[0]} {down[1]} {down[2]}"/><default><geom friction="{friction}"/></default><worldbody>
        {FLOORS[floor].format(m=meter)}{bodies}</worldbody></mujoco>"""
    )
    return mujoco.MjData(model), Stepper(model, Moreau(0.0), scheme=way)


def _tilts(data: mujoco.MjData) -> np.ndarray:
    axes = data.xmat[1:].reshape(-1, 3, 3)[:, :, 2]
    return np.hypot(axes[:, 0], axes[:, 1])


def _places(data: mujoco.MjData) -> np.ndarray:
    return data.qpos.reshape(-1, 7)[:, :2].copy()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("floor", "meter"), [("box", 1.0), ("box", 100.0), ("lid", 1.0)])
def test_cans_stand_on_a_slope(way, floor, meter):
    data, stepper = _scene(way, floor, np.arctan(0.48), meter=meter)
    before = _places(data)
    for _ in range(100):
        stepper.step(data)
        assert stepper.sums.collisions == 0
    assert np.abs(_places(data) - before).max() < 1e-9 * meter
    assert _tilts(data).max() < 1e-9


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("velocity", [0.3, -0.3], ids=["downwards", "upwards"])
@pytest.mark.parametrize("floor", FLOORS)
def test_cans_slide_on_a_slope_without_tipping(way, floor, velocity):
    slope, friction, duration = np.arctan(0.6), 0.45, 0.03
    data, stepper = _scene(way, floor, slope, friction=friction)
    along, before = np.array([np.cos(0.5), np.sin(0.5)]), _places(data)
    data.qvel.reshape(-1, 6)[:, :2] = velocity * along
    for _ in range(15):
        stepper.step(data)
        assert _tilts(data).max() < 1e-9
    slowing = GRAVITY * (np.sin(slope) - np.sign(velocity) * friction * np.cos(slope))
    way_along = velocity * duration + 0.5 * slowing * duration**2
    np.testing.assert_allclose(_places(data) - before, [way_along * along] * len(TURNS), atol=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_cans_tip_over_the_lowest_point_of_their_rims(way):
    """Tilts are ``excess (cosh(rate t) - 1)`` while they are small: an inverted pendulum on that point."""
    limit, far = np.arctan2(RADIUS, HALF), np.hypot(RADIUS, HALF)
    data, stepper = _scene(way, "box", 1.05 * limit)
    for _ in range(30):
        stepper.step(data)
    inertia = 0.25 * RADIUS**2 + HALF**2 / 3.0 + far**2
    tilt = 0.05 * limit * (np.cosh(np.sqrt(GRAVITY * far / inertia) * 0.06) - 1.0)
    np.testing.assert_allclose(_tilts(data), tilt, rtol=2e-3)


@pytest.mark.parametrize(("way", "rtol"), [("event-driven", 1e-4), ("time-stepping", 5e-3)])
def test_cans_rock_as_housners_block(way, rtol):
    """Angular momentum about the new lowest point is what it was (Housner 1963)."""
    half, radius, tilt = 0.15, 0.05, 0.1
    far, inertia = radius**2 + half**2, 0.25 * radius**2 + half**2 / 3.0
    timestep = 1e-3 if way == "event-driven" else 2e-4
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}" integrator="Euler"/><worldbody>
        <geom type="box" size="1 1 1" pos="0 0 -1" friction="2"/><body><freejoint/>
        <geom type="cylinder" size="{radius} {half}" mass="1" friction="2"/></body></worldbody></mujoco>""")
    data, stepper, speeds = mujoco.MjData(model), Stepper(model, Moreau(0.0), scheme=way), []
    data.qpos[2] = half * np.cos(tilt) + radius * np.sin(tilt) + 1e-6
    mujoco.mju_axisAngle2Quat(data.qpos[3:], np.array([0.6, 0.8, 0.0]), tilt)
    for _ in range(round(0.3 / timestep)):
        stepper.step(data)
        for event in stepper.events:
            kept = np.linalg.norm(event.impact.post_velocity[3:])
            speeds.append(kept / np.linalg.norm(event.impact.collision.pre_velocity[3:]))
    assert len(speeds) >= 1
    landed = speeds[0] if way == "event-driven" else min(speeds)
    assert landed == pytest.approx((inertia + far - 2.0 * radius**2) / (inertia + far), rel=rtol)


def _shared_end(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return many points of the boundary of the part that the end of the cylinder shares with the face, (n, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    circle, (base, own) = np.column_stack([np.cos(angle), np.sin(angle)]), data.geom_xpos[:, :2]
    size, turn = model.geom_size, data.geom_xmat[0].reshape(3, 3)[:2, :2]
    rim = own + size[1, 0] * circle
    if model.geom_type[0] == mujoco.mjtGeom.mjGEOM_BOX:
        part = np.linspace(-1.0, 1.0, 20001)[:, None]
        edges = [np.hstack([part, s * np.ones_like(part)]) for s in (-1.0, 1.0)]
        face = base + (np.vstack([*edges, *(edge[:, ::-1] for edge in edges)]) * size[0, :2]) @ turn.T
        inside = (np.abs((rim - base) @ turn) <= size[0, :2]).all(axis=1)
    else:
        face = base + size[0, 0] * circle
        inside = np.linalg.norm(rim - base, axis=1) <= size[0, 0]
    return np.vstack([rim[inside], face[np.linalg.norm(face - own, axis=1) <= size[1, 0]]])


@pytest.mark.parametrize("floor", FLOORS)
def test_contacts_reach_as_far_as_the_end_on_the_face_where_gravity_tips_the_cylinder(floor):
    """The cylinder is in part beyond the face, or larger than it."""
    random, some = np.random.default_rng(3), 0
    sizes = {"box": ".05 .03 .1", "lid": ".05 .1"}
    for _ in range(60):
        radius, (x, y), angle = random.uniform(0.01, 0.08), random.uniform(-0.05, 0.05, 2), random.uniform(0.0, 7.0)
        to = np.array([np.cos(angle), np.sin(angle)])
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option gravity="{to[0]} {to[1]} -9"/><worldbody>
            <geom type="{"box" if floor == "box" else "cylinder"}" size="{sizes[floor]}" euler="0 0 30"/>
            <body pos="{x} {y} .13"><freejoint/><geom type="cylinder" size="{radius} .03"/></body>
            </worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        part = _shared_end(model, data)
        if not len(part):
            continue
        some += 1
        contacts = read_contacts(model, data, within=1e-4)
        found = contacts.position[:, :2]
        np.testing.assert_allclose((found @ to).max(), (part @ to).max(), atol=1e-5)
        np.testing.assert_allclose(contacts.gap, -1e-6, rtol=0.0, atol=1e-13)  # at 1e-6 m convex geoms touch
        ways = np.array([[np.cos(angle), np.sin(angle)] for angle in np.linspace(0.0, 6.2, 30)]).T
        short = (part @ ways).max(axis=0) - (found @ ways).max(axis=0)
        assert short.min() > -1e-5  # no contact is beside the part, and arcs have a contact at least at each quarter
        assert short.max() <= (1.0 - np.sqrt(0.5)) * max(radius, 0.05)
    assert some > 40


def test_no_contact_of_a_tilted_end_is_deeper_than_the_end_above_the_face():
    """The end is in part beyond the face; its points above the face are on a rim and on lines along edges."""
    random, seen = np.random.default_rng(5), 0
    half, (x, y), part = 0.04, (0.05, 0.03), np.linspace(0.0, 1.0, 50001)[:, None]
    corners = np.array([[x, y], [-x, y], [-x, -y], [x, -y], [x, y]])
    edges = np.vstack([a + part * (b - a) for a, b in pairwise(corners)])
    for _ in range(30):
        radius, tilt, way = random.uniform(0.02, 0.06), random.uniform(0.0, 0.13), random.uniform(0.0, 6.3)
        side = np.array([np.cos(way), np.sin(way), 0.0])
        across, axis = np.cross([0.0, 0.0, 1.0], side), np.cos(tilt) * np.array([0, 0, 1]) - np.sin(tilt) * side
        middle = np.append(random.uniform(-0.05, 0.05, 2), 0.0)
        around = np.linspace(0.0, 2.0 * np.pi, 50001)[:, None]
        rim = middle + radius * (np.cos(around) * np.cross(across, axis) + np.sin(around) * across)
        rim = rim[(np.abs(rim[:, :2]) <= (x, y)).all(axis=1)]
        above = np.column_stack([edges, (edges - middle[:2]) @ -axis[:2] / axis[2]])
        points = np.vstack([rim, above[np.linalg.norm(above - middle, axis=1) <= radius]])
        if not len(points):
            continue
        center = middle + half * axis - [0.0, 0.0, points[:, 2].min()]
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><geom type="box" size="{x} {y} .1" pos="0 0 -.1"/>
            <body pos="{center[0]} {center[1]} {center[2]}" zaxis="{axis[0]} {axis[1]} {axis[2]}"><freejoint/>
            <geom type="cylinder" size="{radius} {half}"/></body></worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        contacts = read_contacts(model, data, within=1e-3)
        assert contacts.gap.min() == pytest.approx(-1e-6, abs=3e-7)  # at 1e-6 m convex geoms touch
        closed = np.abs(contacts.position[contacts.gap < 1e-5, :2])
        assert (closed <= np.array([x, y]) + 1e-6).all()
        seen += 1
    assert seen > 20
