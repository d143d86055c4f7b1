"""RK4 steps that compiled code repeats equal steps that it takes once, and steps in Python.

The last stage of an RK4 step need not find the contacts at its end, because the next step detects them itself.
"""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Newton, Stepper
from impactlaw.stepping.soft.without_new_contacts import (
    advance_without_new_contacts,
    contact_forces,
    is_plain,
    keep_start,
    put_start,
)

BALL = """<mujoco><option timestep="0.01" integrator="RK4" gravity="0 0 0"/><worldbody>
  <geom name="floor" type="plane" size="3 3 1"/>
  <body pos="0 0 .2"><joint type="slide" axis="0 0 1" stiffness="-15000"/><geom name="ball" size=".1" mass="1"/></body>
  </worldbody></mujoco>"""
ANT = (
    (0.06587, -0.005076, 0.6728, 0.9878, 0.0865, 0.07513, 0.1054, 0.09718, 1.06, -0.3661, -0.9937, -0.303, -1.22,
     -0.2742, 0.5645),
    (0.4326, 0.3058, -1.731, 1.016, -0.07037, 1.8, -5.028, -0.9993, 8.732, -14.76, -8.564, -0.8834, -8.684, 2.395),
    (0.5259, -0.5795, -0.7912, 0.08681, -0.1989, -0.452, -0.9535, -0.9733),
)  # fmt: skip
"""Positions, velocities and controls of an Ant that reaches a limit only in a middle stage of the step."""
DAMPED = 'solref{}="-2000 -180"'
"""MuJoCo's contact then takes most of the speed in half a timestep: the last stage of RK4 has no contact."""
BEFORE = {
    "floor": f"""<geom type="plane" size="3 3 1" {DAMPED.format("")}/><body pos="0 0 .1">
        <joint type="slide" axis="0 0 1"/><geom size=".1" mass="1" {DAMPED.format("")}/></body>""",
    "joint": f"""<body><joint axis="0 1 0" range="0 360" {DAMPED.format("limit")}/>
        <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/></body>""",
    "tendon": """<body><joint name="slide" type="slide"/><geom size=".1"/></body>""",
}
TENDON = f"""<tendon><fixed limited="true" range="0 9" {DAMPED.format("limit")}><joint joint="slide" coef="1"/></fixed>
    </tendon>"""
"""Scenes whose position is the distance from a contact or limit."""
RESTING = (
    """<body pos="5 0 0"><joint name="resting" type="slide" limited="true" range="1e-5 9"/><geom size=".1"/></body>"""
)
ARM = """<mujoco><option timestep="0.004" integrator="RK4"/><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 .3"><joint name="one" axis="0 1 0" damping=".3" frictionloss=".01"/><joint name="twin" axis="1 0 0"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/><body pos=".3 0 0"><joint name="two" axis="0 1 0"
  damping="0.1 .2" range="-40 40"/><geom type="capsule" fromto="0 0 0 .25 0 0" size=".03"/></body></body></worldbody>
  <tendon><fixed name="pair" damping=".2" stiffness="1"><joint joint="one" coef="1"/><joint joint="two" coef="-.5"/>
  </fixed></tendon><equality><joint joint1="one" joint2="twin"/></equality>
  <actuator><general joint="two" dyntype="filter" dynprm=".05" gainprm="2" ctrlrange="-1 1"/>
  <position tendon="pair" kp="4" kv=".1"/><damper joint="one" kv=".2" ctrlrange="0 1"/></actuator></mujoco>"""
"""All kinds of damping, activation, dry friction, a constraint."""


def test_a_contact_that_was_not_known_collides_as_one_that_was():
    model, ends = mujoco.MjModel.from_xml_string(BALL), []
    for law in (Moreau(0.5), Newton({("ball", "floor"): 0.5}, default=0.1)):
        stepper, data = Stepper(model, law, contact_model="soft"), mujoco.MjData(model)
        batch = Batch(model, law, 1, 1, contact_model="soft")
        data.qvel[0] = batch.bind("qvel")[0] = -4.60887
        for _ in range(4):
            stepper.step(data)
            batch.step()
            ends.append((data.qvel[0], batch.bind("qvel")[0, 0]))
    np.testing.assert_array_equal(ends[:4], ends[4:])
    np.testing.assert_array_equal(*np.transpose(ends))


@pytest.mark.parametrize("beside", ["", RESTING], ids=["alone", "beside a limit"])
@pytest.mark.parametrize("what", BEFORE)
@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_what_only_a_stage_between_meets_collides(compiled, what, beside):
    """Regression: e was 0.03 to 0.48 in effect where a step ended 0.1 to 0.5 of its way before the contact."""
    tendon = TENDON if what == "tendon" else ""
    scene = f"""<mujoco><option timestep="0.01" integrator="RK4" gravity="0 0 0"/>
        <worldbody>{BEFORE[what]}{beside}</worldbody>{tendon}</mujoco>"""
    model = mujoco.MjModel.from_xml_string(scene)
    stepper, found = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled), []
    for speed in (0.3, 2.0):
        for phase in np.arange(0.05, 1.0, 0.1):
            data = mujoco.MjData(model)
            data.qpos[0], data.qvel[0] = (1.0 + phase) * 0.01 * speed, -speed
            stepper.step(data, 20)
            found.append((data.qvel[0] / speed, len(stepper.events)))
    np.testing.assert_allclose(found, [(0.5, 1)] * len(found), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("what", ["joint", "floor"])
def test_energies_after_a_collision_at_the_end_are_those_of_the_end(compiled, what):
    """They were those of the start, where `mj_step` leaves about those of the end."""
    scene = f"""<mujoco><option timestep="0.01" integrator="RK4"><flag energy="enable"/></option>
        <worldbody>{BEFORE[what]}</worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(scene)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    data.qpos[0], data.qvel[0] = 0.012, -2.0
    stepper.step(data)
    assert len(stepper.events) == 1
    told = data.energy.copy()
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(told, data.energy, rtol=1e-12)


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("what", ["joint", "tendon", "floor"])
def test_what_only_a_stage_between_meets_while_a_contact_opens_collides(compiled, what):
    """No stage has more rows than the start, where the opposite limit or the ceiling is active."""
    limits, geom = f'limited="true" range="0 .006" {DAMPED.format("limit")}', DAMPED.format("")
    tendon = f'<tendon><fixed name="rope" {limits}><joint joint="slide" coef="1"/></fixed></tendon>'
    planes = "".join(
        f'<geom name="{name}" type="plane" size="9 9 1" pos="{at} 0 0" zaxis="{way} 0 0" {geom}/>'
        for name, at, way in (("floor", -0.1, 1), ("ceiling", 0.106, -1))
    )
    scene = f"""<mujoco><option timestep="0.01" integrator="RK4" gravity="0 0 0"/>
        <worldbody>{planes if what == "floor" else ""}<body>
        <joint name="slide" type="slide" axis="1 0 0" {limits if what == "joint" else ""}/>
        <geom name="ball" size=".1" {geom}/></body></worldbody>{tendon if what == "tendon" else ""}</mujoco>"""
    model = mujoco.MjModel.from_xml_string(scene)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    data.qpos[0], data.qvel[0] = 0.0061, -2.0
    stepper.step(data)
    label = {"joint": "slide", "tendon": "rope", "floor": "floor/ball"}[what]
    assert data.qvel[0] == pytest.approx(1.0, abs=1e-9)
    assert [event.contacts.labels for event in stepper.events] == [(label,)]


def test_what_a_stage_between_has_met_collides_at_the_end_of_the_step():
    env: Any = gymnasium.make("Ant-v5").unwrapped
    ends = []
    for compiled in (None, "never"):
        stepper = Stepper(env.model, Moreau(1.0), contact_model="soft", compiled=compiled)
        data = mujoco.MjData(env.model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = ANT
        counts = []
        for _ in range(3):
            stepper.step(data)
            counts.append(len(stepper.events))
        ends.append((counts, data.qvel.copy()))
    assert ends[0][0] == ends[1][0] == [1, 1, 1]
    np.testing.assert_allclose(ends[0][1], ends[1][1], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("touches", [True, False])
@pytest.mark.parametrize("scene", ["Ant-v5", "Humanoid-v5", ARM])
def test_what_is_kept_of_the_start_of_a_step_is_all_that_it_is_taken_again_from(scene, touches):
    """The other data have detected other contacts before, in another state."""
    env: Any = None if scene == ARM else gymnasium.make(scene).unwrapped
    model = mujoco.MjModel.from_xml_string(ARM) if env is None else env.model
    data, other, random = mujoco.MjData(model), mujoco.MjData(model), np.random.default_rng(0)
    state, seen = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)), 0
    assert is_plain(model)
    for step in range(300):
        if step % 10 == 0:
            data.ctrl[:] = random.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, other)
        mujoco.mj_forward(model, data)
        again, seen = copy.copy(data), seen + (data.ncon > 0)
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_setState(model, other, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        put_start(other, keep_start(data, touches=touches))
        pushing = contact_forces(model, data) if touches else None
        for one in (again, other):
            advance_without_new_contacts(model, one, pushing=pushing)
        for name in ("qpos", "qvel", "act", "time", "qacc_warmstart"):
            np.testing.assert_array_equal(getattr(other, name), getattr(again, name), err_msg=name)
    assert seen > 20


LINKS = """<mujoco><compiler autolimits="true"/><option timestep="0.01" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body><joint type="ball" range="0 50"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".04" mass="1"/>
  <body pos="0 0 -.3"><joint type="ball" range="0 50"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".04" mass="1"/>
  </body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_step_taken_again_while_something_touches_is_of_rk4(compiled):
    """Regression: Euler took it, whose Coriolis forces create energy: 29 J and more out of 17 J."""
    model = mujoco.MjModel.from_xml_string(LINKS)
    for e, seed in ((0.5, 4), (0.5, 7), (0.8, 2), (0.8, 7)):
        data, highest = mujoco.MjData(model), 0.0
        data.qvel[:] = np.random.default_rng(seed).normal(size=model.nv)
        data.qvel *= np.sqrt(17.0 / _energy(model, data))
        stepper = Stepper(model, Moreau(e), contact_model="soft", compiled=compiled)
        for _ in range(100):
            stepper.step(data)
            highest = max(highest, _energy(model, data))
        assert highest < 17.5


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_actuators_with_more_controls_than_one_change_nothing_in_that(compiled):
    """Regression: transmissions were counted by controls, and what came after them in memory was taken for adhesion."""
    wheel = '<body pos="9 0 0"><joint name="wheel"/><geom size=".1" mass="1"/></body></worldbody>'
    motor = '<dcmotor joint="wheel" resistance="1" inductance=".01" motorconst="1" input="pos vel ff"/>'
    model = mujoco.MjModel.from_xml_string(
        LINKS.replace("</worldbody></mujoco>", f"{wheel}<actuator>{6 * motor}</actuator></mujoco>")
    )
    data, highest = mujoco.MjData(model), 0.0
    data.qvel[:6] = np.random.default_rng(4).normal(size=6)
    data.qvel *= np.sqrt(17.0 / _energy(model, data))
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    for _ in range(100):
        stepper.step(data)
        highest = max(highest, _energy(model, data))
    assert highest < 17.5


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))])
def test_a_copy_takes_the_same_steps(duplicate, compiled):
    """A step is repeated if contacts close with the velocity of its start: not with that of the original's last one."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    stepper.step(data, 50)
    copied, its = duplicate((stepper, data))
    for one, other in ((stepper, data), (copied, its)):
        one.step(other, 400)
    np.testing.assert_array_equal(its.qpos, data.qpos)
    assert stepper.events


def _energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the kinetic energy; `data.energy` is that of the start of a step."""
    now, momentum = mujoco.MjData(model), np.zeros(model.nv)
    now.qpos[:] = data.qpos
    mujoco.mj_fwdPosition(model, now)
    mujoco.mj_mulM(model, now, momentum, data.qvel)
    return float(0.5 * momentum @ data.qvel)
