"""Coefficients keyed by patterns of names."""

import json

import numpy as np
import pytest
from scenes import compiled, run

from impactlaw import Batch, Collision, Compliant, Fremond, Newton, Poisson, Stepper
from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws import Routh, portable, restored
from impactlaw.laws.restitution.labels import check_labels, matches

BALLS = (
    '<geom name="floor" type="plane" size="5 5 1"/>'
    '<body pos="0 0 .105"><joint type="slide" axis="0 0 1"/><geom name="left_foot" size=".1" mass="1"/></body>'
    '<body pos="1 0 .105"><joint type="slide" axis="0 0 1"/><geom name="right_foot" size=".1" mass="1"/></body>'
    '<body pos="2 0 .105"><joint name="knee" type="slide" axis="0 0 1"/><geom name="head" size=".1" mass="1"/></body>'
)
OPTION = 'gravity="0 0 0" timestep="0.01"'


def apart(labels):
    n = len(labels)
    return Collision(np.eye(n), np.eye(n), -np.ones(n), labels=tuple(labels))


@pytest.mark.parametrize(
    ("pattern", "label", "wanted"),
    [
        ("*foot*", "left_foot/floor", True),
        ("*foot*", "floor/left_foot", True),
        ("foot?", "foot1/floor", True),
        ("foot?", "foot12/floor", False),
        ("*foot*/floor", "floor/left_foot", True),
        ("*foot*/floor", "left_foot/box", False),
        ("floor/*foot*", "left_foot/floor", True),
        ("*_joint", "foot_joint", True),
        ("*foot*", "Foot/floor", False),
        ("walker/*foot", "walker/left_foot/floor", True),
        ("floor/walker/*foot", "walker/left_foot/floor", True),
        ("[ab]*/floor", "ball/floor", True),
        ("[ab]*/floor", "cube/floor", False),
    ],
)
def test_what_matches(pattern, label, wanted):
    assert matches(pattern, label) is wanted


def test_the_issues_example():
    law = Newton({("*foot*", "floor"): 0.5}, default=0)
    impact = law.resolve(apart(["left_foot/floor", "floor/right_foot", "left_foot/right_foot", "head/floor"]))
    np.testing.assert_allclose(impact.post_contact_velocity, [0.5, 0.5, 0.0, 0.0], atol=1e-12)


def test_a_name_comes_before_a_pattern():
    law = Newton({"*foot*": 0.5, ("left_foot", "floor"): 0.9}, default=0)
    impact = law.resolve(apart(["floor/left_foot", "right_foot/floor"]))
    np.testing.assert_allclose(impact.post_contact_velocity, [0.9, 0.5], atol=1e-12)


def test_patterns_that_contradict_each_other_are_refused():
    law = Newton({"*foot*": 0.5, "*/floor": 0.2}, default=0)
    with pytest.raises(RestitutionError, match=r"left_foot/floor matches '\*foot\*' and '\*/floor'"):
        law.resolve(apart(["left_foot/floor"]))
    with pytest.raises(RestitutionError, match="make the patterns narrower"):
        Stepper(compiled(BALLS)[0], law)


@pytest.mark.parametrize("law", [Poisson, Routh, lambda table, default: Compliant(table, restitution=0.5)])
def test_other_laws_that_are_keyed(law):
    made = law({"*foot*": 1.0, "head/floor": 0.25}, default=0.0)
    impact = made.resolve(apart(["left_foot/floor", "head/floor"]))
    wanted = [0.5, 0.5] if isinstance(made, Compliant) else [1.0, 0.25]
    np.testing.assert_allclose(impact.post_contact_velocity, wanted, atol=1e-6)


def test_written_down_and_made_again():
    law = Newton({("*foot*", "floor"): 0.5}, default=0)
    assert repr(restored(json.loads(json.dumps(portable(law))))) == repr(law)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (Newton({"*feet*": 0.5}, default=0), r"contact pattern '\*feet\*'"),
        (Newton({("*foot*", "wall"): 0.5}, default=0), "contact pattern"),
        (Fremond({("*foot*", "*foot*"): 0.5}), "unknown contact"),
    ],
)
def test_a_pattern_that_nothing_matches_is_refused(law, message):
    with pytest.raises(UnknownNameError, match=message):
        Stepper(compiled(BALLS)[0], law)


def test_a_pattern_that_leaves_contacts_without_coefficient_is_refused():
    with pytest.raises(RestitutionError, match="floor/head"):
        Stepper(compiled(BALLS)[0], Newton({"*foot*": 0.5}))


def test_unnamed_geoms_have_the_names_of_their_bodies_or_numbers():
    model, _ = compiled(
        '<geom type="plane" size="5 5 1"/><body name="left_foot" pos="0 0 .105"><freejoint/><geom size=".1"/></body>'
    )
    Stepper(model, Newton({"*foot*": 0.5}, default=0))
    Stepper(model, Newton({("*foot*", "geom*"): 0.5}, default=0))


@pytest.mark.parametrize(
    "options",
    [{}, {"scheme": "time-stepping"}, {"scheme": "time-stepping", "compiled": "never"}, {"contact_model": "soft"}],
    ids=["event-driven", "time-stepping", "time-stepping, asked in Python", "soft"],
)
def test_in_every_way_to_step(options):
    model, data = compiled(BALLS, option=OPTION, geom='condim="1" margin="0.02" gap="0.02"')
    if options.get("contact_model") == "soft":
        model, data = compiled(BALLS.replace(".105", ".0999"), option=OPTION, geom='condim="1"')
    data.qvel[:] = -1.0
    stepper = Stepper(model, Newton({"*foot*": 0.5}, default=0), **options)
    run(stepper, data, 1)
    tolerance = 0.1 if options.get("contact_model") == "soft" else 1e-8  # MuJoCo's contacts add speed, too
    np.testing.assert_allclose(data.qvel, [0.5, 0.5, 0.0], atol=tolerance)


def test_in_a_batch():
    model, _ = compiled(BALLS, option=OPTION, geom='condim="1"')
    batch = Batch(model, Newton({"*foot*": 0.5}, default=0), 2)
    qvel = batch.bind("qvel")
    qvel[:] = -1.0
    batch.step()
    np.testing.assert_allclose(qvel, [[0.5, 0.5, 0.0]] * 2, atol=1e-8)


@pytest.mark.parametrize("key", [("floor", "robot/box[0]"), ("robot/box[0]", "floor")])
def test_names_with_slashes_and_brackets_are_found_in_either_order(key):
    label = "robot/box[0]/floor"
    collision = Collision([[1.0]], [[1.0]], [-1.0], labels=[label])
    assert Newton({key: 0.5}).resolve(collision).post_velocity == pytest.approx([0.5])
    check_labels(Newton({key: 0.5}).contact_labels, (label,))
