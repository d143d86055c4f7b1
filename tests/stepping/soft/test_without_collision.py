"""Soft stepping without a collision equals `mj_step`, bit for bit, whatever the scene and the options."""

import itertools
import re

import mujoco
import numpy as np
import pytest
from scenes import INTEGRATORS

from impactlaw import LinearMap, MaximalDissipation, Moreau, Stepper
from impactlaw.scene.contacts import closes, row_velocities
from impactlaw.stepping.collisions import Collider
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.soft.scheme import SoftStepping

VARIANTS = list(itertools.product(INTEGRATORS, ("PGS", "CG", "Newton"), ("pyramidal", "elliptic"), ("dense", "sparse")))

MACHINE = """
<mujoco>
  <option timestep="0.004" integrator="{integrator}" solver="{solver}" cone="{cone}" jacobian="{jacobian}">
    <flag energy="enable"/>
  </option>
  <default><geom friction="0.6 0.01 0.001" condim="4" density="800"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="box" pos="0 0 0.25"><freejoint/>
      <geom type="box" size=".1 .15 .05"/><site name="corner" pos=".1 .1 0"/>
    </body>
    <body name="ball" pos=".02 .01 0.45"><freejoint/><geom type="sphere" size=".08" condim="1"/></body>
    <body name="capsule" pos=".5 0 .3" euler="0 70 0"><freejoint/>
      <geom type="capsule" size=".05 .15" condim="6"/>
    </body>
    <body name="arm" pos="-.6 0 .5">
      <joint name="shoulder" axis="0 1 0" limited="true" range="-15 15" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
      <body name="fore" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.05" frictionloss="0.02"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".03"/><site name="hand" pos=".2 0 0"/>
      </body>
    </body>
    <body name="twin" pos="-.6 .4 .5">
      <joint name="twin" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
    </body>
    <site name="hook" pos="-.2 0 .9"/>
  </worldbody>
  <tendon>
    <spatial name="string" limited="true" range="0 .55" stiffness="3"><site site="hook"/><site site="hand"/></spatial>
    <fixed name="pair"><joint joint="shoulder" coef="1"/><joint joint="elbow" coef="-.5"/></fixed>
  </tendon>
  <equality><joint joint1="shoulder" joint2="twin"/></equality>
  <actuator>
    <motor name="drive" joint="shoulder" gear="3" delay="0.01" nsample="4"/>
    <general joint="elbow" dyntype="filter" dynprm=".05" gainprm="2"/>
    <position tendon="pair" kp="4"/>
  </actuator>
  <sensor>
    <accelerometer site="corner"/><gyro site="corner"/><force site="hand"/><torque site="hand"/><touch site="corner"/>
    <framelinvel objtype="body" objname="ball"/><tendonpos tendon="string"/><subtreeangmom body="arm"/>
    <actuatorfrc actuator="drive"/><clock/><e_kinetic/>
    <jointpos joint="elbow" delay="0.008" nsample="3"/>
  </sensor>
</mujoco>
"""


def machine(integrator="Euler", solver="Newton", cone="pyramidal", jacobian="dense", *, delayed=True):
    xml = MACHINE.format(integrator=integrator, solver=solver, cone=cone, jacobian=jacobian)
    if not delayed:
        xml = re.sub('delay="[0-9.]+" nsample="[0-9]+"', "", xml)
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


# results of a step; MuJoCo's other arrays are scratch memory, partly never written
FIELDS = (
    "qpos qvel act act_dot ctrl qacc qacc_warmstart qacc_smooth qfrc_applied qfrc_actuator qfrc_passive qfrc_bias "
    "qfrc_smooth qfrc_constraint actuator_force actuator_length actuator_velocity sensordata energy xpos xquat "
    "xmat xipos cdof cvel cacc cfrc_int cfrc_ext subtree_com ten_length ten_velocity M qLD efc_type efc_pos "
    "efc_vel efc_aref efc_b efc_force efc_state solver_fwdinv solver_niter"
)


def assert_same(data, reference):
    """Assert equality, bit for bit."""
    for name in FIELDS.split():
        np.testing.assert_array_equal(getattr(data, name), getattr(reference, name), err_msg=name)
    for name in ("dist", "pos", "frame", "geom", "efc_address"):
        np.testing.assert_array_equal(getattr(data.contact, name), getattr(reference.contact, name), err_msg=name)
    np.testing.assert_array_equal(data.warning.number, reference.warning.number)
    assert data.time == reference.time
    assert data.ncon == reference.ncon


def drive(model, data, step, i):
    data.ctrl[:] = np.sin(0.05 * i + np.arange(model.nu))
    step()
    mujoco.mj_rnePostConstraint(model, data)


@pytest.mark.parametrize(
    ("delayed", "integrator", "solver", "cone", "jacobian"),
    [(True, *variant) for variant in VARIANTS] + [(False, *variant) for variant in VARIANTS if variant[0] == "RK4"],
)
def test_a_step_without_collision_is_mj_step(delayed, integrator, solver, cone, jacobian):
    """What has a history is tried in other data without new contacts, where RK4 is; all else in the same data."""
    model, data = machine(integrator, solver, cone, jacobian, delayed=delayed)
    assert (model.nhistory > 0) == delayed
    reference = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", rest_speed=1e9)
    kinds = set()
    for i in range(250):
        drive(model, data, lambda: stepper.step(data), i)
        drive(model, reference, lambda: mujoco.mj_step(model, reference), i)
        assert stepper.events == ()
        kinds |= set(data.efc_type)
        assert_same(data, reference)
    constraint = mujoco.mjtConstraint
    contact = constraint.mjCNSTR_CONTACT_PYRAMIDAL if cone == "pyramidal" else constraint.mjCNSTR_CONTACT_ELLIPTIC
    wanted = (constraint.mjCNSTR_EQUALITY, constraint.mjCNSTR_LIMIT_JOINT, constraint.mjCNSTR_LIMIT_TENDON, contact)
    assert {int(kind) for kind in (*wanted, constraint.mjCNSTR_FRICTION_DOF)} <= kinds


@pytest.mark.parametrize(("cone", "jacobian"), list(itertools.product(("pyramidal", "elliptic"), ("dense", "sparse"))))
def test_closing_is_told_from_constraint_rows(cone, jacobian):
    """Equality and friction rows precede limits, limits precede contacts, and contacts of condim 1 have one row."""
    model, data = machine(cone=cone, jacobian=jacobian)
    model.geom("floor").condim[:] = 1
    data.qpos[7:10] = 2.0, 0.0, 0.0799  # the ball, away from the box
    collider = Collider(Moreau(0.5), MaximalDissipation(), "raise", 100, "auto")
    stepping = SoftStepping(model, collider, make_plan(model, "soft"), rest_speed=0.1)
    rng = np.random.default_rng(0)
    seen, dims = np.zeros(4, dtype=int), set()
    for i in range(150):
        drive(model, data, lambda: mujoco.mj_step(model, data), i)
        mujoco.mj_forward(model, data)
        _, J = stepping.collisions.active(data)
        if len(J) == 0:
            assert not closes(model, data, data.efc_vel, -1e9)
            continue
        dims |= set(data.contact.dim)
        for velocity in (data.qvel.copy(), rng.standard_normal(model.nv)):
            fastest = -(J @ velocity).min()
            rows = row_velocities(model, data, velocity)
            assert not closes(model, data, rows, fastest + 1e-9)
            assert closes(model, data, rows, fastest - 1e-9)
        seen += np.array([data.ne, data.nf, data.nl, data.ncon]) > 0
    assert (seen > 10).all()
    assert {1, 4, 6} <= dims


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_sliding_fast_is_no_collision(integrator):
    """Rows of a pyramidal cone mix in tangential speed; only the normal speed counts."""
    model, data = machine(integrator)
    data.joint(model.body("box").jntadr[0]).qpos[2] = 0.0499
    data.joint(model.body("box").jntadr[0]).qvel[:2] = 3.0, 1.0
    data.qpos[9] = data.qpos[16] = 2.0
    reference = mujoco.MjData(model)
    reference.qpos[:], reference.qvel[:] = data.qpos, data.qvel
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    fastest = 0.0
    for i in range(12):  # later the box, which MuJoCo has lifted under RK4, falls back
        drive(model, data, lambda: stepper.step(data), i)
        drive(model, reference, lambda: mujoco.mj_step(model, reference), i)
        fastest = min(fastest, data.efc_vel.min(initial=0.0))
        assert stepper.events == ()
        assert_same(data, reference)
    assert fastest < -0.5


@pytest.mark.parametrize(("integrator", "solver", "cone", "jacobian"), VARIANTS)
def test_a_law_that_changes_nothing_changes_nothing(integrator, solver, cone, jacobian):
    model, data = machine(integrator, solver, cone, jacobian)
    reference = mujoco.MjData(model)
    stepper = Stepper(model, LinearMap(np.eye(model.nv)), contact_model="soft", on_inadmissible="allow")
    collisions = 0
    for i in range(150):
        drive(model, data, lambda: stepper.step(data), i)
        drive(model, reference, lambda: mujoco.mj_step(model, reference), i)
        collisions += len(stepper.events)
        assert_same(data, reference)
    assert collisions > 5  # each contact as it closes


@pytest.mark.parametrize("integrator", INTEGRATORS[:4])
def test_the_second_half_of_a_step_is_mj_step2(integrator):
    model, data = machine(integrator)
    reference = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", rest_speed=1e9)
    for i in range(150):
        drive(model, data, lambda: (mujoco.mj_step1(model, data), stepper.finish_step(data)), i)
        drive(model, reference, lambda: (mujoco.mj_step1(model, reference), mujoco.mj_step2(model, reference)), i)
        assert_same(data, reference)
    assert data.ncon > 0


def test_the_second_half_of_a_step_stays_rk4():
    model, data = machine("RK4")
    reference = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", rest_speed=1e9)
    for i in range(50):
        drive(model, data, lambda: (mujoco.mj_step1(model, data), stepper.finish_step(data)), i)
        drive(model, reference, lambda: mujoco.mj_step(model, reference), i)
        for name in ("qpos", "qvel", "act", "qacc_warmstart"):
            np.testing.assert_array_equal(getattr(data, name), getattr(reference, name), err_msg=name)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("law", [None, "identity"])
def test_the_control_callback_is_called_as_by_mj_step(integrator, law):
    model, data = machine(integrator)
    reference = mujoco.MjData(model)
    law, rest = (Moreau(0.5), 1e9) if law is None else (LinearMap(np.eye(model.nv)), 0.1)
    stepper = Stepper(model, law, contact_model="soft", rest_speed=rest, on_inadmissible="allow")
    calls = {"n": 0}

    def control(m, d):
        calls["n"] += 1
        d.ctrl[:] = -0.2 * d.qvel[: m.nu] + d.time

    counts = []
    mujoco.set_mjcb_control(control)
    try:
        for step in (lambda: stepper.step(data), lambda: mujoco.mj_step(model, reference)):
            calls["n"] = 0
            for _ in range(120):
                step()
            counts.append(calls["n"])
        assert_same(data, reference)
        assert counts[0] == counts[1] == 120 * (4 if integrator == "RK4" else 1)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        stepper.step(data), mujoco.mj_step(model, reference)
        assert_same(data, reference)
    finally:
        mujoco.set_mjcb_control(None)


@pytest.mark.parametrize("callback", [None, lambda m, d: None])
def test_flags_energy_and_inverse_comparison(callback):
    model, data = machine()
    reference = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", rest_speed=1e9)
    mujoco.set_mjcb_control(callback)
    try:
        for flags in (0, int(mujoco.mjtEnableBit.mjENBL_FWDINV), int(mujoco.mjtEnableBit.mjENBL_ENERGY)):
            model.opt.enableflags = flags
            for _ in range(40):
                for d, step in ((data, stepper.step), (reference, lambda d: mujoco.mj_step(model, d))):
                    mujoco.mj_energyPos(model, d)  # a user looked; MuJoCo clears it where the flag is off
                    step(d)
                assert_same(data, reference)
            if flags == int(mujoco.mjtEnableBit.mjENBL_FWDINV):
                assert data.solver_fwdinv.any()
    finally:
        mujoco.set_mjcb_control(None)
