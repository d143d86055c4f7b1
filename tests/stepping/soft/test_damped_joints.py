"""Light fingers with stiff joints do not explode when squeezed between their limits and a palm."""

import itertools

import mujoco
import numpy as np
import pytest
from scenes import compiled as compiled_scene
from scenes import mass_matrix

from impactlaw import Moreau, Stepper

LINK = """<joint name="{0}" axis="0 1 0" range="0 60" limited="true" damping="{1}"/>
  <inertial pos=".02 0 0" mass=".01" diaginertia="{2} {2} {2}"/>
  <geom type="capsule" fromto="0 0 0 .04 0 0" size=".01"/>"""


def finger(damping, inertia, overlap):
    """Return two links over a palm, bent and stretched by servos; h D is 4 to 67 times their moments of inertia."""
    first, second = (LINK.format(name, damping, inertia) for name in "ab")
    return compiled_scene(
        f"""<geom type="box" size=".05 .05 .02" pos="0 0 {overlap - 0.02}"/>
        <body pos="0 0 .01">{first}<body pos=".045 0 0">{second}</body></body>""",
        '<actuator><position joint="a" kp="2"/><position joint="b" kp="2"/></actuator>',
        option='gravity="0 0 0"',
    )


def fastest(step, data):
    speeds = []
    for i in range(400):
        data.ctrl[:] = -0.3 if i // 40 % 2 else 0.3
        step(data)
        speeds.append(np.abs(data.qvel).max())
    return max(speeds)


FINGERS = pytest.mark.parametrize(
    ("damping", "inertia", "overlap"),
    [(0.1, 1e-6, 5e-4), (0.1, 1e-6, 5e-3), (0.1, 5e-6, 5e-4), (0.1, 5e-6, 2e-3), (0.3, 5e-6, 5e-4), (1.0, 2e-5, 5e-4)],
)


@FINGERS
@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_finger_between_its_limits_and_a_palm(damping, inertia, overlap, compiled):
    model, data = finger(damping, inertia, overlap)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    plain = mujoco.MjData(model)
    assert fastest(stepper.step, data) <= fastest(lambda plain: mujoco.mj_step(model, plain), plain) + 1e-9


ARM = """<joint axis="0 1 0" damping="1"/><geom type="capsule" fromto="0 0 0 .16 0 0" size=".03" mass=".5" {0}/>"""


def largest_gain(step, model, data):
    """Return the largest gain of a scene's energy in one step, relative to its initial kinetic energy."""
    energies = []
    for _ in range(40):
        energies.append(0.5 * data.qvel @ mass_matrix(model, data) @ data.qvel)
        step(data)
    return np.diff(energies).max() / energies[0]


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize(
    ("angles", "speeds", "mass"),
    [((0.177, -0.049), (18.2, 5.9), 0.72), ((0.16, -0.115), (18.4, 6.7), 3.4), ((0.08, -0.22), (17.3, 14.9), 0.25)],
)
def test_damping_does_not_throw_what_an_arm_hits(angles, speeds, mass, compiled):
    """Two links, the second with h D = 2 M, turn and hit a bar that turns."""
    inner, outer = ARM.format('contype="0" conaffinity="0"'), ARM.format("")
    model, data = compiled_scene(
        f"""<body>{inner}<body pos=".18 0 0">{outer}</body></body>
        <body pos=".3 0 -.15"><joint axis="0 1 0" pos="0 0 -.1" damping=".02"/>
        <geom type="capsule" fromto="-.1 0 0 .1 0 0" size=".06" mass="{mass}"/></body>""",
        option='gravity="0 0 0" timestep="0.01"',
    )
    plain = mujoco.MjData(model)
    for start in data, plain:
        start.qpos[:2], start.qvel[:2] = angles, speeds
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    bare = largest_gain(lambda plain: mujoco.mj_step(model, plain), model, plain)
    assert largest_gain(stepper.step, model, data) <= bare


@pytest.mark.parametrize(
    ("damping", "inertia", "integrator"),
    [
        *itertools.product([0.0, 0.002], [5e-6], ["EULER", "IMPLICITFAST", "RK4"]),
        *itertools.product([0.1, 1.0], [5e-6], ["EULER", "IMPLICITFAST"]),  # stiffer than RK4 can integrate
    ],
)
@pytest.mark.parametrize("friction", ["convex", "ignore"])
def test_compiled_steps_are_those_in_python(damping, inertia, integrator, friction):
    """The first link is flat on the palm: the normal of one of its contacts intersects the axis of its hinge.

    With friction, this contact and a limit that closes with it leave no restitution in some steps.
    """
    model, data = finger(damping, inertia, 5e-4)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    options = {"contact_model": "soft", "friction": friction}
    ours = Stepper(model, Moreau(0.5), compiled="auto", **options)
    python = Stepper(model, Moreau(0.5), compiled="never", **options)
    other, collisions = mujoco.MjData(model), 0
    for i in range(200):
        data.ctrl[:] = -0.3 if i // 40 % 2 else 0.3
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        speeds = [other.qvel, *(event.impact.collision.pre_velocity for event in python.events)]
        fastest = np.abs(speeds).max()  # a jam can stop all motion
        np.testing.assert_allclose(data.qvel, other.qvel, rtol=0.0, atol=1e-10 * fastest)
        assert ours.sums.collisions == python.sums.collisions
        collisions += ours.sums.collisions
    assert collisions > 0
    assert ours.short_steps == python.short_steps
    assert friction == "convex" or ours.short_steps == 0


def test_redundant_constraints_of_damped_joints_are_chosen_alike():
    """Regression: in Python nearly redundant rows were chosen by M, in compiled code by ``M + h D``: 3.8e-4 apart.

    A platform on three parallel bars, of which damping locks two, hits a wall.
    """
    bar = """<body pos="{} 0 1"><joint axis="0 1 0" damping="{}"/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5" mass="{}" contype="0" conaffinity="0"/>{}</body>"""
    platform = """<body name="platform" pos="0 0 -.5"><joint axis="0 1 0" damping=".01"/>
        <geom type="box" size=".5 .05 .03" pos=".4 0 0" mass="2" contype="0" conaffinity="0"/>
        <geom size=".06" pos="1 0 0" mass=".1"/></body>"""
    light = [bar.format(0.4 * i, 5, 0.05, "").replace("<body", f'<body name="{i}"') for i in (1, 2)]
    model, data = compiled_scene(
        '<geom type="plane" size="3 3 1" pos="1.065 0 .5" zaxis="-1 0 .2"/>'
        + bar.format(0, 0.01, 1, platform)
        + "".join(light),
        "<equality>"
        + "".join(f'<connect body1="{i}" body2="platform" anchor="0 0 -.5"/>' for i in "12")
        + "</equality>",
    )
    data.qvel[:] = -3.0, 3.0, -3.0, -3.0
    ours = Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto")
    python = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    other, collisions = mujoco.MjData(model), 0
    for _ in range(20):
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        np.testing.assert_allclose(data.qvel, other.qvel, rtol=0.0, atol=1e-11)
        collisions += python.sums.collisions
    assert collisions > 0


@pytest.mark.parametrize("bodies", [0, 4, 40])
def test_a_damped_joint_leaves_other_bodies_alone(bodies):
    """Where damping almost locks one joint, the mass matrix is factored differently for all collisions."""
    joint = '<joint type="hinge" axis="0 1 0" limited="true" range="-.1 .1" damping="{}"/>'
    links = "".join(
        f'<body pos="{i} 0 0">{joint.format(damping)}<geom size=".05" pos=".2 0 0"/></body>'
        for i, damping in enumerate([0.1, 1, 10, 100])
    )
    others = (
        '<body pos="0 0 5"><freejoint/><geom size=".1"/><body pos=".3 0 0"><joint/><geom size=".05"/></body></body>'
    )
    model, data = compiled_scene(links + bodies * others)
    model.geom_contype[:] = 0
    ours = Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto")
    python = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    other, collisions = mujoco.MjData(model), 0
    for _ in range(100):
        data.qvel[:4] = np.where(np.abs(data.qpos[:4]) < 0.05, 2.0, data.qvel[:4])
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        np.testing.assert_allclose(data.qvel, other.qvel, rtol=0.0, atol=1e-11)
        collisions += python.sums.collisions
    assert collisions > 30


def carriage(damping, option=""):
    """Return a carriage of 4 kg that falls at 1 m/s on a finger of two light links, and the data."""
    model, data = compiled_scene(
        f"""<geom type="plane" size="1 1 1"/><body pos="0 0 .12"><joint type="slide" axis="0 0 1"/>
            <geom type="box" size=".03 .03 .01" mass="4" contype="0" conaffinity="0"/>
            <body pos="0 0 -.01" euler="0 -12 0"><joint axis="0 1 0" damping="{damping}"/>
              <geom type="capsule" fromto="0 0 0 0 0 -.04" size=".008" mass=".01"/>
              <body pos="0 0 -.045"><joint axis="0 1 0" damping="{damping}"/>
                <geom type="box" size=".006 .006 .015" pos="0 0 -.018" mass=".003"/></body></body></body>""",
        option=f'timestep="2e-3" {option}',
    )
    data.qvel[0] = -1.0
    return model, data


def rises(step, model, data):
    """Return the energy gains of 60 steps, J."""
    copied, energies = mujoco.MjData(model), []
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for _ in range(60):
        copied.qpos[:], copied.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, copied)
        energies.append(copied.energy.sum())
        step(data)
    return np.diff(energies)


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_trunk_of_joints_in_series_lands(compiled):
    """Regression: seven landings gained up to .64 of their energy in a step.

    Damping locks the light links between two heavy boxes, although each joint carries a heavy box.
    """
    joint = '<joint axis="0 1 0" damping="80" armature=".02"/>'
    link = f'{joint}<geom type="capsule" size=".05" fromto="0 0 0 .05 0 0" mass=".3"/>'
    box = '<geom type="box" size=".2 .1 .1" pos="{} 0 0" mass="15"/>'
    model, data = compiled_scene(
        f"""<geom type="plane" size="9 9 1"/><body><freejoint/>{box.format(0)}<body pos=".25 0 0">{link}
        <body pos=".06 0 0">{link}<body pos=".25 0 0">{joint}{box.format(0.2)}</body></body></body></body>""",
        option='gravity="0 0 0" timestep=".005"',
    )
    assert (model.opt.timestep * 80 < model.dof_M0[6:]).all()
    gains = []
    for tilt in np.linspace(0.2, 0.8, 7):
        mujoco.mj_resetData(model, data)
        data.qpos[2], data.qvel[2] = 0.9, -8.0
        mujoco.mju_euler2Quat(data.qpos[3:7], [0.3, tilt, 0.2], "xyz")
        stepper = Stepper(model, Moreau(1.0), contact_model="soft", compiled=compiled)
        gains.append(largest_gain(stepper.step, model, data))
    assert max(gains) < 0.02


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "discrete"])
@pytest.mark.parametrize(("damping", "restitution"), list(itertools.product([0.01, 0.05, 0.3, 1.0], [0.0, 0.5])))
def test_light_links_throw_no_carriage(damping, restitution, integrator, compiled):
    """Regression: of 6.7 J, up to 5.2 J were created because MuJoCo's contacts balanced the damping of moved links."""
    model, data = carriage(damping, f'integrator="{integrator}"')
    stepper = Stepper(model, Moreau(restitution), contact_model="soft", compiled=compiled)
    assert rises(stepper.step, model, data).max() < 0.02


@pytest.mark.parametrize("bounces", [False, True])
def test_steps_in_two_halves_are_those_of_one(bounces):
    model, data = carriage(0.05)
    if bounces:
        model.geom_solref[:] = -1000.0, -1.0
    whole = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    halves, other = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never"), mujoco.MjData(model)
    other.qvel[:] = data.qvel
    for _ in range(60):
        whole.step(data)
        mujoco.mj_step1(model, other)
        halves.finish_step(other)
        np.testing.assert_array_equal(data.qvel, other.qvel)
        np.testing.assert_array_equal(data.qacc, other.qacc)
        np.testing.assert_array_equal(data.M, other.M)
    assert data.ncon > 0


def test_steps_that_touch_nothing_are_those_of_mujoco():
    model, data = carriage(0.05)
    stepper, plain = Stepper(model, Moreau(0.5), contact_model="soft"), mujoco.MjData(model)
    data.qpos[0] = plain.qpos[0] = 1.0
    plain.qvel[:] = data.qvel
    for _ in range(60):
        stepper.step(data)
        mujoco.mj_step(model, plain)
    np.testing.assert_array_equal(data.qpos, plain.qpos)


@pytest.mark.parametrize("options", ['solver="PGS"', 'noslip_iterations="3"'])
def test_other_solvers_of_mujoco_take_the_mass_matrix_that_they_have_made_before(options):
    """Compiled and Python steps agree, although energy is created there."""
    model, data = carriage(0.05, options)
    ours, python = (Stepper(model, Moreau(0.5), contact_model="soft", compiled=how) for how in ("auto", "never"))
    other = mujoco.MjData(model)
    for _ in range(40):
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        np.testing.assert_allclose(data.qvel, other.qvel, rtol=0.0, atol=1e-9 * np.abs(other.qvel).max())


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_energy_and_callbacks_see_the_mass_matrix_as_it_is(compiled):
    model, data = carriage(0.05)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    stepper, collisions = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled), 0
    before = mujoco.MjData(model)
    for _ in range(30):
        before.qpos[:] = data.qpos
        stepper.step(data)
        if stepper.sums.collisions:
            collisions += 1
            mujoco.mj_forward(model, before)
            after = stepper.events[-1].impact.post_velocity
            assert data.energy[1] == pytest.approx(0.5 * after @ mass_matrix(model, before) @ after, rel=1e-9)
    assert collisions > 0


def test_a_control_callback_sees_the_mass_matrix_as_it_is():
    model, data = carriage(0.05)
    stepper, seen = Stepper(model, Moreau(0.5), contact_model="soft"), []

    def control(model, data):
        seen.append((data.qpos.copy(), data.M.copy()))

    mujoco.set_mjcb_control(control)
    try:
        for _ in range(30):
            stepper.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert data.ncon > 0
    for qpos, matrix in seen[1:]:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        np.testing.assert_allclose(matrix, data.M, rtol=1e-12)
