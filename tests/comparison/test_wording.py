"""Refusals of `impactlaw compare` name what the command has."""

import re

import pytest

from impactlaw.comparison.wording import in_options

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
NAMED = re.compile(r"(contact_model|scheme|overlap|friction|gap_tolerance|max_events|on_inadmissible)=|\w\(")


@pytest.mark.parametrize(
    ("scene", "words", "advice"),
    [
        ("flex", (), "the scene has a flex; compare cannot take it"),
        ("overlap", (), "or let --scheme time-stepping do it"),
        ("override", (), "pair_friction"),
        ("sticky", (), "the scene has adhesion; use --scheme time-stepping"),
        ("huge", (), "use --scheme time-stepping"),
        ("stack", ("--laws", "routh", "--timestep", "0.01"), "take --laws poisson, which is for any number"),
        ("stack", ("--laws", "routh", "--friction", "convex"), "--friction convex contradicts it"),
    ],
)
def test_refusals_name_options_of_the_command(scene, words, advice, command, tmp_path):
    option, body = SCENES[scene]
    (tmp_path / "scene.xml").write_text(f"<mujoco>{option}<worldbody>{FLOOR}{body}</worldbody></mujoco>")
    code, _, err = command("compare", "scene.xml", "--duration", "0.1", *words)
    assert code == 2, err
    assert advice in err
    assert not NAMED.search(err), err
    assert len(err.splitlines()) == 1, err


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ('choose a dissipative law, or on_inadmissible="project" or "allow"', "choose a dissipative law"),
        ('relative residual 1e-3; use a smaller timestep, or friction="convex"',
         "relative residual 1e-3; use a smaller timestep, or --friction convex"),
        ("the contact jams; take Coulomb around Newton or Poisson",
         "the contact jams; take --laws newton or --laws poisson"),
        ("restitution must lie in [0, 1], got 2.0", "restitution must lie in [0, 1], got 2.0"),
    ],
)  # fmt: skip
def test_advice_is_told_in_options(said, told):
    assert in_options(said) == told
