"""Errors and warnings of commands name the command's own options, and say where other options belong."""

import sys
import warnings
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.envs.registration import EnvSpec

from impactlaw.cli import Compare, Laws, Plan
from impactlaw.wording import in_options

BALL = '<body pos="0 0 {z}"><freejoint/><geom name="{name}" size=".1"/></body>'
FLOOR = '<geom name="floor" type="plane" size="1 1 1"/>'
FLEX = """<body name="table"><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" radius=".01">
  <edge equality="true"/></flexcomp></body>"""
SCENES = {
    "flex": ("", FLEX),
    "overlap": ("", BALL.format(z=0.05, name="ball")),
    "override": ('<option><flag override="enable"/></option>', BALL.format(z=1, name="ball")),
    "sticky": ("", BALL.format(z=1, name="ball").replace("size", 'adhesion="1" size')),
    "huge": ("", BALL.format(z=1e12, name="ball")),
    "stack": ("", BALL.format(z=0.1, name="low") + BALL.format(z=0.294, name="high").replace("0 0 0", ".05 0 0")),
}


@pytest.mark.parametrize(
    ("scene", "words", "advice"),
    [
        ("flex", (), 'a flex; use contact_model="soft" (contact_model: an option of impactlaw.Stepper, in Python)'),
        ("overlap", (), 'let overlap="push-out", or --scheme time-stepping, do it (overlap: an option of'),
        ("override", (), "pair_friction"),
        ("sticky", (), "the scene has adhesion; use --scheme time-stepping or contact_model"),
        ("huge", (), "or use --scheme time-stepping (gap_tolerance: an option of impactlaw.Stepper, in Python)"),
        ("stack", ("--laws", "routh", "--friction", "convex"), "--friction convex contradicts it"),
    ],
)
def test_refusals_name_options_of_the_command(scene, words, advice, command, tmp_path):
    write(scene, tmp_path)
    code, _, err = command("compare", "scene.xml", "--duration", "0.1", *words)
    assert code == 2, err
    assert advice in err
    assert len(err.splitlines()) == 1, err


def test_the_table_tells_what_ended_a_run_in_options_of_the_command(command, tmp_path):
    write("stack", tmp_path)
    words = "--laws", "routh", "poisson", "--timestep", "0.01", "--duration", "0.1"
    code, out, err = command("compare", "scene.xml", *words)
    assert code == 0, err
    assert "take Poisson's law, which is for any number" in " ".join(out.split())


def write(scene, folder):
    option, body = SCENES[scene]
    (folder / "scene.xml").write_text(f"<mujoco>{option}<worldbody>{FLOOR}{body}</worldbody></mujoco>")


@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (("plan", "scene.xml"), "use --scheme time-stepping or --contact-model soft\n"),
        (("study", "--tasks", "Sticky-v0", "--act", "moreau:0.5", "--policies", "studies.acting:stay", "--schemes",
          "event-driven"), 'use --schemes time-stepping or contact_model="soft" (contact_model: an option of'),
    ],
)  # fmt: skip
def test_refusals_of_other_commands(arguments, advice, command, tmp_path, monkeypatch):
    write("sticky", tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(gymnasium.registry, "Sticky-v0", EnvSpec("Sticky-v0", lambda: Sticky(tmp_path / "scene.xml")))
    code, _, err = command(*arguments)
    assert (code, len(err.splitlines())) == (2, 1), err
    assert advice in err


class Sticky(MujocoEnv):
    """An environment whose contacts pull."""

    metadata: ClassVar = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"], "render_fps": 500}

    def __init__(self, path):
        super().__init__(str(path), 1, gymnasium.spaces.Box(-np.inf, np.inf, (1,)))


def test_warnings_are_one_line_in_options(command, tmp_path):
    """Regression: a warning had two lines of Python, with the place in the code."""
    touch = BALL.format(z=1, name="ball").replace("<geom", '<site name="skin" size=".1"/><geom')
    sensor = '</worldbody><sensor><touch name="felt" site="skin"/></sensor></mujoco>'
    (tmp_path / "scene.xml").write_text(f"<mujoco><worldbody>{FLOOR}{touch}{sensor}")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, _, err = command("compare", "scene.xml", "--duration", "0.01", "--laws", "moreau")
    assert code == 0, err
    lines = [line for line in err.splitlines() if "sensors such as felt" in line]
    assert len(lines) == 1
    assert lines[0].startswith("impactlaw: event-driven steps leave no forces")
    assert "use --scheme time-stepping or contact_model" in lines[0]
    assert "UnreadSensorsWarning" not in err


@pytest.mark.parametrize(
    ("command", "said", "told"),
    [
        (Compare(), 'choose another, or on_inadmissible="project" or "allow"',
         'choose another, or on_inadmissible="project" or "allow" (on_inadmissible: an option of impactlaw.Stepper, '
         "in Python)"),
        (Compare(), 'relative residual 1e-3; use a smaller timestep, or friction="convex"',
         "relative residual 1e-3; use a smaller timestep, or --friction convex"),
        (Compare(), "a larger max_events, or overlap='push-out'",
         "a larger max_events, or overlap='push-out' (max_events, overlap: options of impactlaw.Stepper, in Python)"),
        (Plan("wedge"), "contact_model means nothing", "--contact-model means nothing"),
        (Plan("wedge"), "the scheme, and friction", "the scheme, and friction"),
        (Laws(), "restitution must lie in [0, 1], got 2.0", "restitution must lie in [0, 1], got 2.0"),
    ],
)  # fmt: skip
def test_advice_is_told_in_options(command, said, told):
    assert in_options(said, command) == told
