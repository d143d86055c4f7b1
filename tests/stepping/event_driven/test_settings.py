"""Laws, restitution and options of a scene in rigid stepping: their effects, and what is refused."""

from functools import partial

import pytest
import scenes

from impactlaw import Fremond, Moreau, Newton, Stepper
from impactlaw.errors import (
    InadmissibleImpactError,
    OverlapError,
    RestitutionError,
    SceneError,
    UnknownNameError,
)
from impactlaw.models import load

FLOOR = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'
compiled = partial(scenes.compiled, option='timestep="0.01" gravity="0 0 0"')


def ball(name="ball", pos="0 0 1", size="0.1", condim=1):
    return f'<body name="{name}" pos="{pos}"><freejoint/><geom name="{name}" size="{size}" condim="{condim}"/></body>'


def test_overlap_at_the_start_is_named_with_its_depth():
    model, data = compiled(FLOOR + ball(pos="0 0 0.07"))
    with pytest.raises(OverlapError, match=r"floor/ball by 0\.03 m"):
        Stepper(model, Moreau(1)).step(data)


def test_overlap_made_between_steps_is_named_too():
    model, data = compiled(FLOOR + ball())
    stepper = Stepper(model, Moreau(1))
    stepper.step(data)
    data.qpos[2] = 0.05
    with pytest.raises(OverlapError, match=r"floor/ball by 0\.05 m"):
        stepper.step(data)


@pytest.mark.parametrize(
    ("world", "rest", "message"),
    [
        (FLOOR.replace("/>", ' adhesion="1"/>') + ball(), "", "adhesion"),
        (FLOOR + ball(), '<actuator><adhesion body="ball" ctrlrange="0 1"/></actuator>', "adhesion"),
        (
            FLOOR + ball().replace("/>", ' name="free"/>', 1),
            '<actuator><motor joint="free" gear="1 0 0 0 0 0" delay="0.01" nsample="9"/></actuator>',
            "delay",
        ),
    ],
)
def test_what_rigid_stepping_does_not_cover_is_refused(world, rest, message):
    model, _ = compiled(world, rest=rest)
    with pytest.raises(SceneError, match=message):
        Stepper(model, Moreau(1))


def test_friction_can_be_ignored_on_request():
    model, data = compiled(FLOOR + ball(pos="0 0 0.1", condim=3))
    data.qvel[:3] = 1.0, 0.0, -1.0
    stepper = Stepper(model, Moreau(1), friction="ignore")
    stepper.step(data)
    assert data.qvel == pytest.approx([1, 0, 1, 0, 0, 0])


def test_a_matrix_that_creates_energy_is_raised_projected_or_allowed():
    gains = Fremond([[0.0, 2.0], [2.0, 0.0]])
    model, data = load("ball_chain")
    before = data.qpos.copy(), data.qvel.copy()
    with pytest.raises(InadmissibleImpactError, match=r"ball1/ball2, ball2/ball3.*T\+/T-"):
        Stepper(model, gains).step(data)
    assert (data.qpos == before[0]).all()
    assert (data.qvel == before[1]).all()
    allowed, projected = (Stepper(model, gains, on_inadmissible=option) for option in ("allow", "project"))
    projected.step(data)
    impact = projected.events[0].impact
    assert impact.violations.is_admissible(1e-9)
    assert impact.energy_change == pytest.approx(0.0, abs=1e-9)
    _, data = load("ball_chain")
    allowed.step(data)
    assert allowed.events[0].impact.energy_change > 0.1


def test_the_scene_carries_its_own_restitution():
    rest = """<custom><numeric name="restitution" data="0.5"/>
        <numeric name="restitution/ball/floor" data="0.9"/></custom>"""
    model, data = compiled(FLOOR + ball(pos="0 0 .1") + ball("other", "1 0 .1"), rest=rest)
    data.qvel[[2, 8]] = -1.0
    Stepper(model, "scene").step(data)
    assert data.qvel[[2, 8]] == pytest.approx([0.9, 0.5])


@pytest.mark.parametrize(
    ("numeric", "error", "message"),
    [
        ('<numeric name="restitution" data="1.5"/>', RestitutionError, "1.5"),
        ('<numeric name="restitution/ball/flor" data="0.5"/>', UnknownNameError, "ball/floor"),
        ('<numeric name="other" data="0.5"/>', RestitutionError, "carries no restitution"),
    ],
)
def test_wrong_restitution_in_the_scene_is_named(numeric, error, message):
    model, _ = compiled(FLOOR + ball(), rest=f"<custom>{numeric}</custom>")
    with pytest.raises(error, match=message):
        Stepper(model, "scene")


def test_a_law_for_contacts_the_scene_cannot_have_is_refused():
    model, _ = compiled(FLOOR + ball())
    with pytest.raises(UnknownNameError, match="floor/ball"):
        Stepper(model, Newton({("ball", "flor"): 0.5}, default=1.0))


@pytest.mark.parametrize(
    "option", [{"contact_model": "hard"}, {"friction": "no"}, {"on_inadmissible": "warn"}, {"solver": "simplex"}]
)
def test_unknown_options_are_named(option):
    model, _ = compiled(FLOOR + ball())
    with pytest.raises(UnknownNameError, match=str(next(iter(option.values())))):
        Stepper(model, Moreau(1), **option)


def test_an_event_prints_as_one_line():
    model, data = load("ball_chain")
    stepper = Stepper(model, Moreau(0.0))
    stepper.step(data)
    assert repr(stepper.events) == "(<ImpactEvent at 0 s: ball1/ball2, ball2/ball3, T+ - T- = -0.3333 J>,)"
