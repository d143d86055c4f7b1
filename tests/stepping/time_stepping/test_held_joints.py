"""Scenes whose joints time stepping would hold still cause a warning when a stepper is made."""

from contextlib import nullcontext

import pytest
from scenes import compiled

from impactlaw import Batch, Moreau, Stepper
from impactlaw.cli import main
from impactlaw.errors import HeldJointsWarning
from impactlaw.stepping.cautions import cautions

FINGER = """<body name="palm" pos="0 0 1"><geom name="palm" type="box" size=".1 .1 .05" mass="1"/>
  <body pos="0 0 .06"><body name="tip" pos="0 0 {shift}"><joint name="finger" type="slide" axis="1 0 .1" {joint}/>
    <geom name="finger" type="box" size=".01 .01 .03" mass=".1"/></body></body></body>"""


def gripper(shift=0.0, joint="", actuator="", rest=""):
    """Return a finger 2 cm inside its palm, or shifted out of it, with a link without joints between them."""
    return compiled(FINGER.format(shift=shift, joint=joint), rest=rest + f"<actuator>{actuator}</actuator>")


def test_links_that_overlap_are_named():
    model, _ = gripper()
    with pytest.warns(HeldJointsWarning, match="palm/finger by 20 mm; where no motion opens that"):
        Stepper(model, Moreau(0.5), scheme="time-stepping")
    with pytest.warns(HeldJointsWarning, match="palm/finger"):
        Batch(model, Moreau(0.5), 2, 1)


@pytest.mark.parametrize("ways", [{}, {"contact_model": "soft"}])
def test_other_ways_to_step_do_not_warn(ways):
    Stepper(gripper()[0], Moreau(0.5), **ways)


def test_a_finger_beside_its_palm_is_not_told():
    assert cautions(gripper(shift=0.02)[0]) == ()


def test_links_that_do_not_collide_are_not_told():
    model, _ = gripper(rest='<contact><exclude body1="palm" body2="tip"/></contact>')
    assert cautions(model) == ()


def test_far_limbs_and_bodies_of_others_are_not_told():
    """Three joints between two links, or separate mechanisms, can always open an overlap."""
    link = '<body><joint type="hinge" axis="0 1 0"/>{}</body>'
    ball = '<geom size=".1" mass="1"/>'
    chain = f'<body>{ball}<body><joint axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' + (
        link.format('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' + link.format(ball)) + "</body></body>"
    )
    assert cautions(compiled(chain)[0]) == ()
    assert cautions(compiled(f"<body><freejoint/>{ball}</body><body><freejoint/>{ball}</body>")[0]) == ()


@pytest.mark.parametrize(
    ("actuator", "told"),
    [
        ('<motor joint="finger" ctrlrange="-7 7" ctrllimited="true"/>', "finger (7 of 30)"),
        ('<motor joint="finger" ctrlrange="-7 7" ctrllimited="true" gear="5"/>', None),
        ('<motor joint="finger"/>', None),
        ('<motor joint="finger" forcerange="-9 9" forcelimited="true"/>', "finger (9 of 30)"),
        ('<position joint="finger" kp="10" ctrlrange="-1 1" ctrllimited="true"/>', "finger (20 of 30)"),
        ('<position joint="finger" kp="20" ctrlrange="-1 1" ctrllimited="true"/>', None),
        ('<velocity joint="finger" kv="1" ctrlrange="-1 1" ctrllimited="true"/>', None),
        ("", None),
    ],
)
def test_servos_that_dry_friction_holds_are_told(actuator, told):
    joint = 'frictionloss="30" range="-1 1" limited="true"'
    model, _ = gripper(shift=0.05, joint=joint, actuator=actuator)
    found = cautions(model)
    assert len(found) == (told is not None)
    assert told is None or told in found[0]
    if told is not None:
        with pytest.warns(HeldJointsWarning, match="cannot overcome the frictionloss"):
            Stepper(model, Moreau(0.0), scheme="time-stepping")


@pytest.mark.parametrize("control", ["quat", "expmap"])
def test_servos_after_one_of_several_controls_and_forces_are_told(control):
    """Regression: a servo of a ball joint has three forces and three or four controls, not one of each."""
    wrist = '<body pos="3 0 0"><joint name="wrist" type="ball"/><geom size=".1" mass="1"/></body>'
    actuators = (
        f'<orientation joint="wrist" kp="1" input="{control}"/>'
        '<motor joint="finger" ctrlrange="-7 7" ctrllimited="true" gear="2"/>'
    )
    model, _ = compiled(
        FINGER.format(shift=0.05, joint='frictionloss="30"') + wrist, rest=f"<actuator>{actuators}</actuator>"
    )
    assert [text.split("exact: ")[1].split(";")[0] for text in cautions(model)] == ["finger (14 of 30)"]


@pytest.mark.parametrize("loss", [0, 30])
def test_what_is_told_is_so(loss):
    motor = '<motor joint="finger" forcelimited="true" forcerange="-9 9"/>'
    model, data = gripper(0.05, f'frictionloss="{loss}" damping="1"', motor)
    held = bool(cautions(model))
    assert held == (loss > 0)
    with pytest.warns(HeldJointsWarning) if held else nullcontext():
        stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    data.ctrl[0] = 5.0
    for _ in range(50):
        stepper.step(data)
    assert (abs(data.qpos[0]) < 1e-3) == held


def test_the_plan_tells_it(monkeypatch, capsys, tmp_path):
    path = tmp_path / "gripper.xml"
    path.write_text(f"<mujoco><worldbody>{FINGER.format(shift=0, joint='')}</worldbody></mujoco>")
    for scheme, told in (("time-stepping", True), ("event-driven", False)):
        monkeypatch.setattr("sys.argv", ["impactlaw", "plan", str(path), "--scheme", scheme])
        main()
        lines = capsys.readouterr().out.splitlines()
        assert lines[-1].startswith("caution   links of one mechanism overlap: palm/finger by 20 mm") == told


def test_limbs_that_overlap_where_they_are_joined_are_not_told():
    """A force at the centre of a joint does not move it."""
    limb = '<geom type="capsule" size=".02" fromto="0 0 0 {} 0 .2" mass="1"/>'
    first, second = (f'<body><joint axis="0 1 0"/>{limb.format(x)}</body>' for x in (0.2, -0.2))
    model, _ = compiled(f'<body><freejoint/><geom size=".02" mass="1"/>{first}{second}</body>')
    assert cautions(model) == ()
