"""The plan of a step is true of the scene, and the parts that it leaves out have no effect."""

from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest
from scenes import assert_steps_of_mujoco, compiled

from impactlaw import Coulomb, MaximalDissipation, Moreau, Stepper
from impactlaw.cli import main
from impactlaw.models import load, scene_names
from impactlaw.stepping.collisions import Collider
from impactlaw.stepping.event_driven.scheme import RigidStepping
from impactlaw.stepping.plan import Plan, format_plan, has_constant_inertia, make_plan

FLAGS = tuple(field.name for field in fields(Plan) if field.type == "bool")
FLOOR = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'


def body(name, geom, joint="<freejoint/>"):
    return f'<body name="{name}" pos="0 0 1">{joint}<geom name="{name}" {geom} condim="1"/></body>'


BALL, BOX = 'type="sphere" size=".1"', 'type="box" size=".1 .2 .3"'
CYLINDER = 'type="cylinder" size=".1 .2"'


@pytest.mark.parametrize(
    ("world", "needed"),
    [
        (body("ball", BALL), set()),
        (FLOOR + body("ball", BALL), {"rest", "detection"}),
        (FLOOR + body("box", BOX), {"rest", "detection", "points", "turning"}),
        (FLOOR + body("a", BALL) + body("b", BALL), {"rest", "detection", "passing"}),
        (body("a", BOX) + body("b", BALL), {"rest", "detection", "passing", "turning"}),
        (
            body("a", CYLINDER) + body("b", BOX),
            {"rest", "detection", "convex", "faces", "points", "passing", "turning"},
        ),
        (
            FLOOR + body("arm", BALL + ' pos=".3 0 0"', '<joint type="hinge" axis="0 1 0"/><joint axis="1 0 0"/>'),
            {"rest", "detection", "inertia"},
        ),
        (FLOOR + body("ball", BALL + ' pos=".05 0 0"'), {"rest", "detection", "inertia"}),
    ],
)
def test_flags_follow_the_scene(world, needed):
    plan = make_plan(compiled(world)[0])
    assert {name for name in FLAGS if getattr(plan, name)} == needed


@pytest.mark.parametrize("name", scene_names())
def test_leaving_out_changes_nothing(name):
    """The same steps with every part forced to run end in the same state."""
    model, data = load(name)
    _, other = load(name)
    lean = Stepper(model, Moreau(0.5))
    plan = replace(lean.plan, **dict.fromkeys(FLAGS, True))
    assert plan != lean.plan
    law = Coulomb(Moreau(0.5)) if lean.plan.friction else Moreau(0.5)
    collider = Collider(law, MaximalDissipation(), "raise", 100, "auto")
    full = RigidStepping(model, collider, plan, exact=True, gap_tolerance=1e-9)
    for _ in range(60):
        lean.step(data)
        full.step(other)
    assert data.qpos == pytest.approx(other.qpos, abs=1e-9)
    assert data.qvel == pytest.approx(other.qvel, abs=1e-7)


@pytest.mark.parametrize("name", scene_names())
def test_constant_inertia_is_constant(name):
    model, data = load(name)
    rng = np.random.default_rng(5)
    matrices = []
    for _ in range(20):
        dq = rng.normal(size=model.nv)
        mujoco.mj_integratePos(model, data.qpos, dq, 1.0)
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        matrices.append(M)
    spread = np.ptp(matrices, axis=0).max() / np.abs(matrices).max()
    assert spread < 1e-12 or not has_constant_inertia(model)
    if name in ("newtons_cradle", "ball_chain", "billiard_rack", "bouncing_ball", "box_drop"):
        assert has_constant_inertia(model)


def test_a_changed_mass_counts_though_inertia_was_constant():
    """Domain randomization changes masses between steps; the law uses the new ones."""
    model, data = load("ball_chain")
    stepper = Stepper(model, Moreau(1))
    stepper.step(data)
    mass = stepper.events[0].impact.collision.mass_matrix[0, 0]
    data.qpos[:] = model.key("start").qpos
    data.qvel[:] = model.key("start").qvel
    model.body_mass[1] *= 2.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    stepper.step(data)
    assert stepper.events[0].impact.collision.mass_matrix[0, 0] == pytest.approx(2.0 * mass)


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
@pytest.mark.parametrize("integrator", [0, 1, 3])
def test_a_scene_without_pairs_is_stepped_by_mujoco_alone(contact_model, integrator):
    model, _ = compiled(body("ball", BALL) + body("arm", BOX + ' contype="0" conaffinity="0"', '<joint damping=".1"/>'))
    model.opt.integrator = integrator
    data, bare = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(1), contact_model=contact_model)
    assert not stepper.plan.detection
    assert_steps_of_mujoco(stepper, data, bare, 50)
    assert data.time == bare.time


def test_every_part_has_a_reason():
    for name in scene_names():
        for contact_model in ("rigid", "soft"):
            plan = make_plan(load(name)[0], contact_model)
            assert all(part.name and part.why for part in plan.parts)
            assert len({part.name for part in plan.parts}) == len(plan.parts)
            assert len(format_plan(plan).splitlines()) == len(plan.parts)


def test_the_command_prints_what_runs_first(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["impactlaw", "plan", "box-drop"])
    main()
    lines = capsys.readouterr().out.splitlines()
    runs = [line.startswith("runs") for line in lines]
    assert runs == sorted(runs, reverse=True)
    assert any("matching of contact points" in line for line in lines[: sum(runs)])


def test_the_command_refuses_what_rigid_stepping_refuses(monkeypatch, capsys, tmp_path):
    path = tmp_path / "sticky.xml"
    sticky = FLOOR.replace("/>", ' adhesion="1"/>')
    path.write_text(f"<mujoco><worldbody>{sticky}{body('ball', BALL)}</worldbody></mujoco>")
    monkeypatch.setattr("sys.argv", ["impactlaw", "plan", str(path)])
    with pytest.raises(SystemExit):
        main()
    assert "adhesion" in capsys.readouterr().err


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_a_mocap_body_and_what_stands_still_never_meet(contact_model):
    """As in MuJoCo, because impulses can move neither of them."""
    sunk = f'<body name="table" mocap="true"><geom name="table" {BOX}/></body>'
    model, _ = compiled(FLOOR + sunk)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    plan = make_plan(model, contact_model)
    assert not plan.detection
    assert not plan.surfaces
    assert make_plan(compiled(FLOOR + sunk + body("ball", BALL))[0], contact_model).surfaces


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_belts_that_mujoco_ignores(contact_model):
    """MuJoCo only checks for belts when a scene is compiled."""
    model, _ = compiled(FLOOR + body("ball", BALL))
    model.geom_surfacevel[0, 0] = 1.0
    plan = make_plan(model, contact_model)
    assert not plan.surfaces
    assert "compiled without surfacevel" in format_plan(plan)
