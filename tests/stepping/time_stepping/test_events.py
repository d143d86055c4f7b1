"""Collisions in events, early and late; reading events has no effect."""

import copy

import mujoco
import numpy as np
import pytest
from scenes import chain_labels, compiled
from stepping.time_stepping.stepped import FLOOR, first_impact, stepping

from impactlaw import Coulomb, Fremond, FrictionImpact, LinearMap, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.models import SCENES, load
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.solvers.problem import Status

LAWS = {
    "maximal dissipation": MaximalDissipation(),
    "moreau": Moreau(0.6),
    "newton": Newton(0.6),
    "newton of speed": Newton(lambda speed: 0.5),
    "poisson": Poisson(0.6),
    "reversal": Fremond.reversal(),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
PILE = FLOOR + "".join(
    f'<body pos="{0.03 * i} 0 {0.25 * i + 0.2}" euler="{30 * i} 20 0"><freejoint/>'
    f'<geom name="{k}{i}" type="{k}" size=".1 .08 .06"/></body>'
    for i, k in enumerate(["box", "capsule", "sphere", "box"])
)


def told(event):
    """Return the contents of an event, as plain arrays."""
    impact = event.impact
    seen = [
        np.array([event.time]), event.qpos, event.contacts.geoms, event.contacts.gap, event.contacts.position,
        event.contacts.normal, impact.impulse, impact.post_velocity, impact.collision.pre_velocity,
        impact.collision.mass_matrix, impact.collision.jacobian,
    ]  # fmt: skip
    return [np.array(a) for a in seen], event.contacts.labels


def same(a, b):
    assert a[1] == b[1]
    for x, y in zip(a[0], b[0], strict=True):
        np.testing.assert_array_equal(x, y)


def scene_or_pile(name):
    return compiled(PILE, geom='friction=".4"') if name == "pile" else load(name)


@every_law
@pytest.mark.parametrize("scene", [*SCENES, "pile"])
def test_events_are_admissible_and_what_the_step_did(scene, law):
    """In a scene without forces the velocity after the step is that of its last event.

    This does not hold if an open contact that does not collide is kept from penetrating in the same step.
    """
    model, data = scene_or_pile(scene)
    model.opt.gravity[:] = 0
    rng = np.random.default_rng(7)
    data.qvel[:] += 0.3 * rng.normal(size=model.nv)
    stepper = stepping(model, law)
    constant = scene != "pile" and model.njnt == (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE).sum()
    for _ in range(100):
        before, time, whole = data.qvel.copy(), data.time, False
        stepper.step(data)
        for k, event in enumerate(stepper.events):
            impact = event.impact
            assert time <= event.time <= data.time
            if k == 0 or (constant and whole):
                assert impact.collision.pre_velocity == pytest.approx(before, abs=1e-12 if k == 0 else 1e-7)
            assert impact.residual < 1e-8
            assert (impact.impulse >= -1e-12).all()
            pushed = data.efc_pos[
                (data.efc_force > 1e-9) & (data.efc_type >= int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT))
            ]
            whole = not (pushed > 1e-9).any() or len(stepper.events) > 1
            if whole or not isinstance(law, type(Fremond.reversal())):  # the only one here that can create energy
                assert impact.violations.is_admissible(1e-7)
                assert impact.energy_change <= 1e-9 * impact.collision.kinetic_energy
            assert len(event.contacts.labels) == len(impact.impulse) == len(event.contacts.gap)
            before = impact.post_velocity
        if constant and stepper.events and whole:
            assert data.qvel == pytest.approx(before, abs=1e-7)


def test_labels_are_those_of_geoms_and_joints_in_order():
    model, data = load("newtons_cradle")
    stepper = stepping(model, Fremond.reversal())
    stepper.step(data)
    (event,) = stepper.events
    assert event.contacts.labels == tuple(chain_labels(5))
    assert event.contacts.normal == pytest.approx(np.tile([1.0, 0, 0], (4, 1)), abs=1e-2)


@every_law
def test_contact_velocities_before_and_after_are_those_of_the_law(law):
    """For one contact, gamma+ = -e gamma-."""
    ball = '<body pos="0 0 .101"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="2"/></body>'
    model, data = compiled(FLOOR + ball, geom='condim="1"')
    data.qvel[0] = -2.0
    stepper = stepping(model, law)
    stepper.step(data)
    (event,) = stepper.events
    e = {"maximal dissipation": 0, "reversal": 1, "newton of speed": 0.5}.get(
        next(name for name, value in LAWS.items() if value is law), 0.6
    )
    impact = event.impact
    assert impact.collision.pre_contact_velocity == pytest.approx([-2.0], abs=1e-12)
    assert impact.post_contact_velocity == pytest.approx([2.0 * e], abs=1e-9)
    assert impact.impulse == pytest.approx([2 * (1 + e) * 2.0], abs=1e-9)
    assert impact.energy_change == pytest.approx(-0.5 * 2 * 4 * (1 - e**2), abs=1e-8)
    assert event.contacts.labels == ("floor/ball",)
    assert event.contacts.position[0] == pytest.approx([0, 0, 0], abs=2e-3)
    assert event.contacts.normal[0] == pytest.approx([0, 0, 1], abs=1e-12)


@every_law
@pytest.mark.parametrize("scene", ["newtons_cradle", "billiard_rack", "falling_rod", "box_drop", "pile"])
def test_reading_events_late_gives_the_same_and_reading_them_changes_nothing(scene, law):
    runs, late, early = [], [], []
    for read in (True, False):
        model, data = scene_or_pile(scene)
        stepper, seen = stepping(model, law), []
        for _ in range(220):
            stepper.step(data)
            seen.append(np.concatenate([data.qpos, data.qvel, [stepper.shortfall]]))
            if read:
                early += [told(event) for event in stepper.events]
            else:
                late.append(copy.copy(stepper))
        runs.append(np.array(seen))
    mujoco.mj_resetData(model, data)
    data.qpos[:] = 0.3
    stepper.step(data)
    np.testing.assert_array_equal(*runs)
    events = [told(event) for later in late for event in later.events]
    assert len(events) == len(early) > 0
    for one, other in zip(events, early, strict=True):
        same(one, other)


def test_events_of_a_step_that_nobody_reads_are_gone_with_the_next():
    model, data = load("ball_chain")
    stepper = stepping(model, Moreau(1))
    stepper.step(data)
    assert len(stepper.events) == 1
    assert stepper.events is stepper.events
    stepper.step(data)
    assert stepper.events == ()


def test_an_impact_with_friction_tells_its_friction():
    ball = '<body pos="0 0 .101"><freejoint/><geom name="ball" size=".1" mass="1"/></body>'
    model, data = compiled(FLOOR + ball, option='gravity="0 0 0"', geom='friction=".1"')
    data.qvel[[0, 2]] = 3.0, -1.0
    stepper = stepping(model, Coulomb(Newton(0.5)))
    stepper.step(data)
    (event,) = stepper.events
    impact = event.impact
    assert isinstance(impact, FrictionImpact)
    assert impact.impulse == pytest.approx([1.5], abs=1e-9)
    assert np.linalg.norm(impact.friction_impulse) == pytest.approx(0.15, abs=1e-9)
    assert impact.post_velocity == pytest.approx(data.qvel, abs=1e-9)
    assert impact.restitution_scale == 1.0


def test_an_event_whose_friction_is_not_found_is_not_told_as_one_of_the_law(monkeypatch):
    for place in ("stepping.time_stepping.events", "mechanics.friction_impact"):
        monkeypatch.setattr(f"impactlaw.{place}.solve_cones", _stopped)
    model, data = compiled(PILE, geom='friction=".4"')
    stepper = stepping(model, Moreau(0.5))
    _, event = first_impact(stepper, data)
    assert event.projected
    assert event.impact.target_contact_velocity is None


def _stopped(*arguments, **limits):
    return solve_cones(*arguments, **limits)._replace(status=Status.STOPPED)


def test_a_box_that_lands_flat_has_four_equal_impulses():
    model, data = load("box_drop")
    stepper = stepping(model, Moreau(0.5))
    while not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    assert len(event.contacts.labels) == 4
    assert event.impact.impulse == pytest.approx(np.full(4, event.impact.impulse.mean()), rel=1e-9)


def test_what_rests_on_the_floor_is_in_the_event_of_what_hits_it():
    """A ball at rest on the floor is hit from above: both contacts collide, under any law."""
    balls = "".join(
        f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="{n}" size=".1" mass="1"/></body>'
        for n, z in (("low", 0.1), ("high", 0.301))
    )
    for law in LAWS.values():
        model, data = compiled(FLOOR + balls, option='gravity="0 0 0"', geom='condim="1"')
        data.qvel[1] = -1.0
        stepper = stepping(model, law)
        stepper.step(data)
        (event,) = stepper.events
        assert event.contacts.labels == ("floor/low", "low/high")
        assert event.impact.post_velocity == pytest.approx(data.qvel, abs=1e-9)


def test_a_law_of_linear_map_tells_its_event():
    model, data = load("ball_chain")
    stepper = stepping(model, LinearMap(np.eye(3)[::-1]))
    stepper.step(data)
    (event,) = stepper.events
    assert event.impact.impulse == pytest.approx([1, 1], abs=1e-9)


def test_many_steps_with_events_that_nobody_reads_do_not_pile_up():
    import gc
    import tracemalloc

    model, data = compiled(PILE)
    stepper = stepping(model, Moreau(0.9))
    for _ in range(100):
        stepper.step(data)
    gc.collect()
    tracemalloc.start()
    for _ in range(50):
        stepper.step(data)
    first = tracemalloc.get_traced_memory()[0]
    for _ in range(200):
        stepper.step(data)
    gc.collect()
    second = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert second - first < 200_000


def test_events_of_a_limit_that_an_equality_holds_can_be_read():
    """A tendon limits the difference of two coupled slides: its limit cannot open, whatever the law asks."""
    world = "".join(
        f'<body pos="0 {y} 0"><joint name="{n}" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'
        for n, y in (("one", 0), ("two", 1))
    )
    rest = """<equality><joint joint1="one" joint2="two"/></equality><tendon><fixed name="apart" range="-.1 .001">
        <joint joint="one" coef="1"/><joint joint="two" coef="-1"/></fixed></tendon>"""
    for law in LAWS.values():
        model, data = compiled(world, rest, option='gravity="0 0 0"')
        data.qvel[:] = 1.0, -1.0
        stepper, count = stepping(model, law), 0
        for _ in range(30):
            stepper.step(data)
            count += len(stepper.events)
            assert np.isfinite(data.qpos).all()
        assert count > 0


@pytest.mark.parametrize("how", ["auto", "never"])
def test_a_hand_that_a_servo_drives_hits_the_floor(how):
    """The weld to a mocap body may give way in collisions: in the event it does not hold the hand."""
    model, data = compiled(
        FLOOR
        + """<body name="target" mocap="true" pos="0 0 .3"/>
        <body name="hand" pos="0 0 .3"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/>
        <body pos="0 0 -.05"><joint type="slide" axis="1 0 0"/><geom name="tip" size=".02" pos="0 0 -.05" mass=".1"/>
        </body></body>""",
        '<equality><weld body1="target" body2="hand"/></equality>',
        option='timestep=".002"',
    )
    stepper = stepping(model, Moreau(0.5), compiled=how)
    while not stepper.sums.collisions:
        data.mocap_pos[0, 2] -= 0.3 * model.opt.timestep
        stepper.step(data)
    sums, (event,) = stepper.sums, stepper.events
    impact, approach = event.impact, event.impact.collision.pre_contact_velocity[0]
    assert approach == pytest.approx(-0.3, rel=0.02)
    assert impact.post_contact_velocity[0] == pytest.approx(-0.5 * approach, rel=1e-9)
    assert impact.violations.is_admissible()
    assert sums.inadmissible == 0
    assert sums.energy_change == pytest.approx(impact.energy_change, rel=1e-9)
    assert sums.energy_change == pytest.approx(-0.375 * impact.collision.mass_matrix[2, 2] * approach**2, rel=0.05)
    assert abs(sums.surface_work) < 1e-12


@pytest.mark.parametrize("how", ["auto", "never"])
@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_the_tip_of_a_four_bar_linkage_hits_the_floor(friction, how):
    """With friction it jams: on its curved path, friction lets no impulse of the floor throw it back.

    Because the constraint drifts, there is no exact solution. Regression: the event had impulses of 1e12 N s.
    """
    bars = """<geom name="floor" type="plane" size="3 3 1" pos="0 0 -.5" contype="1" conaffinity="1"/>
    <body><joint axis="0 1 0"/><geom fromto="0 0 0 0 0 -.4"/>
    <body pos="0 0 -.4"><joint axis="0 1 0"/><geom fromto="0 0 0 .5 0 0"/>
    <geom name="tip" type="sphere" size=".05" pos=".25 0 -.1" contype="1" conaffinity="1"/>
    <body name="last" pos=".5 0 0"><joint axis="0 1 0"/><geom fromto="0 0 0 0 0 .4"/></body></body></body>
    <body name="post" pos=".5 0 0"/>"""
    closed = '<equality><connect body1="last" body2="post" anchor="0 0 .4"/></equality>'
    shape = f'type="capsule" size=".02" contype="0" conaffinity="0" friction="{friction}"'
    model, data = compiled(bars, closed, option='timestep=".002"', geom=shape)
    data.qpos[:] = 0.9, -0.9, 0.9
    stepper = stepping(model, Moreau(0.5), compiled=how)
    while not stepper.sums.collisions:
        stepper.step(data)
    (event,) = stepper.events
    impact = event.impact
    approach, energy = -impact.collision.pre_contact_velocity[0], impact.collision.kinetic_energy
    assert approach == pytest.approx(0.72, rel=0.01)
    assert 0.0 < impact.impulse[0] < 10.0
    assert abs(impact.surface_work) < 0.01 * energy  # of the drifting constraint
    assert impact.post_contact_velocity[0] == pytest.approx(0.0 if friction else 0.5 * approach, abs=0.01)
    assert stepper.sums.inadmissible == bool(friction)
