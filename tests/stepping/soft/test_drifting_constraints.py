"""Limits of joints driven by a constraint: they act by the motion that it allows, not through its drift."""

import mujoco
import numpy as np
import pytest
from scenes import compiled as compile_scene

from impactlaw import Moreau, Stepper

KNEE = """<body><joint name="knee" axis="0 1 0" {limit}/><geom size=".1" pos="0 0 -.4" mass="1"/>
    <body pos="0 0 -.4"><joint name="slip" type="slide" axis="1 0 0" range="0 .1" armature=".01"/>
    <geom size=".1" mass=".1"/></body></body>"""
COUPLING = '<equality><joint joint1="slip" joint2="knee" polycoef="0 .003 0 0 0"/></equality>'
"""A knee whose shank slips by 3 mm per radian, as in musculoskeletal models; both joints have a limit at 0."""
WAYS = [{"compiled": "auto"}, {"compiled": "never"}]


def stepped(limit, velocity, law, **way):
    model, data = compile_scene(KNEE.format(limit=limit), COUPLING, option='gravity="0 0 0"')
    data.qpos[:], data.qvel[:] = (-1e-3, -1e-5), velocity
    stepper = Stepper(model, law, contact_model="soft", **way)
    stepper.step(data)
    assert stepper.short_steps == 0
    assert len(stepper.events) == 1
    return stepper.events[0], data


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_drift_is_not_made_up_for_by_the_joint_that_drives(e, way):
    """The knee could stop the slip of 1 cm/s alone, but only by turning 3.3 rad/s faster."""
    event, data = stepped('range="0 120"', (-1.0, -0.01), Moreau(e), **way)
    assert event.contacts.labels == ("knee",)
    np.testing.assert_allclose(event.impact.post_contact_velocity, e, atol=1e-9)
    assert abs(data.qvel[0]) < 0.6


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("drift", [0.0, 1e-5])
def test_a_driven_limit_stops_what_drives_it(drift, way):
    """With little or no drift, the limit of the slip acts as a limit of the knee: -35 rad/s become 17.5."""
    event, data = stepped("", (-35.0, -0.105 - drift), Moreau(0.5), **way)
    assert event.contacts.labels == ("slip",)
    np.testing.assert_allclose(data.qvel[0], 17.5, rtol=0.02)


@pytest.mark.parametrize("way", WAYS)
def test_a_driven_limit_at_rest_holds_what_drives_it(way):
    """A ball hits the knee, whose only limit is that of the slip, which drifts as much as solvers leave."""
    ball = """<body pos="-.1999 0 -.4"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>"""
    model, data = compile_scene(KNEE.format(limit="") + ball, COUPLING, option='gravity="0 0 0"', geom='condim="1"')
    data.qpos[1], data.qvel[:] = -1e-6, (0.0, -1e-9, 1.0)
    stepper = Stepper(model, Moreau(0.0), contact_model="soft", **way)
    stepper.step(data)
    assert "slip" in stepper.events[0].contacts.labels
    np.testing.assert_allclose(stepper.events[0].impact.post_velocity, 0.0, atol=1e-5)
    assert stepper.short_steps == 0


FINGER = """<geom type="plane" size="5 5 .1"/>
  <body pos="0 0 .12"><joint type="slide" axis="0 0 1"/><geom size=".01"/>
   <body pos=".03 0 0"><joint axis="0 1 0" range="-60 .5"/>
    <geom type="capsule" fromto="0 0 0 .03 0 -.03" size=".004"/>
    <body name="coupler" pos=".03 0 -.03"><joint axis="0 1 0"/>
     <geom type="capsule" fromto="0 0 0 0 0 -.04" size=".004"/></body></body>
   <body name="follower" pos=".01 0 -.02"><joint axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .03 0 -.03" size=".004"/></body></body>"""
"""A finger of four bars that `LOOP` closes; one of its joints is at its limit."""
LOOP = '<equality><connect body1="coupler" body2="follower" anchor="0 0 -.02"/></equality>'


def thrown(rng, model, data):
    """Set the finger, pulled apart by millimetres, to velocities that violate the loop by a tenth at most."""
    mujoco.mj_resetData(model, data)
    data.qpos[:] = 0.0, np.deg2rad(0.5) + 1e-4, *rng.uniform(-0.02, 0.02, 2)
    mujoco.mj_forward(model, data)
    J = data.efc_J.reshape(-1, model.nv)[: data.ne]
    v = rng.normal(0.0, 20.0, model.nv) * (0.05, 1.0, 1.0, 1.0)
    data.qvel[:] = v - np.linalg.pinv(J, rcond=1e-6) @ J @ v * (1.0 - rng.uniform(0.0, 0.1))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_constraints_that_give_way_do_not_drive_collisions(e, way):
    """At most a fiftieth of the energy of a collision's velocity jump may come from the loop."""
    rng, collisions = np.random.default_rng(0), 0
    model, data = compile_scene(FINGER, LOOP, option='timestep="2e-3" jacobian="dense"')
    for _ in range(100):
        thrown(rng, model, data)
        stepper = Stepper(model, Moreau(e), contact_model="soft", **way)
        stepper.step(data)
        for event in stepper.events:
            collisions += 1
            assert event.impact.energy_change <= 0.01 * event.impact.intensity**2
    assert collisions > 30


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_sums_tell_what_constraints_that_drift_do(compiled):
    """One of two masses on a rod hits the floor; the work of the rod's drift u is its impulse times u."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><geom type="plane" size="9 9 1"/>
        <body name="a" pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1" condim="1"/></body>
        <body name="b" pos="0 0 .9"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="3"/></body></worldbody>
        <equality><connect body1="b" body2="a" anchor="0 0 0"/></equality></mujoco>"""
    )
    data, u = mujoco.MjData(model), 0.02
    data.qpos[0] = -1e-4
    data.qvel[:] = -1.0, -1.0 + u
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    stepper.step(data)
    (event,) = stepper.events
    assert event.impact.surface_work == pytest.approx(stepper.sums.surface_work, rel=1e-9)
    assert stepper.sums.surface_work == pytest.approx(3.0 * 1.5 * u, rel=1e-2)  # 3 kg change by 1.5 m/s
