"""A law for some contacts of a scene, with or without joint limits."""

import gymnasium
import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import AnyOutcome, Compliant, Coulomb, Fremond, LinearMap, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import OptionError, RestitutionError, UnknownNameError
from impactlaw.laws import Law, Routh

WORLD = (
    '<geom name="floor" type="plane" size="5 5 1"/>'
    '<body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom name="left_foot" size=".1" mass="1"/></body>'
    '<body pos="1 0 .1"><joint type="slide" axis="0 0 1"/><geom name="head" size=".1" mass="1"/></body>'
    '<body pos="2 0 1"><joint name="knee" type="slide" axis="0 0 1" limited="true" range="0 1"/>'
    '<geom name="shin" size=".1" mass="1" contype="0" conaffinity="0"/></body>'
)
OPTION = 'gravity="0 0 0" timestep="0.01"'
RIGID = {
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
    "asked in Python": {"scheme": "time-stepping", "compiled": "never"},
}
SOFT = {"contact_model": "soft"}
FOOT, HEAD, KNEE = 0, 1, 2


def scene(option=OPTION):
    return compiled(WORLD, option=option, geom='condim="1"')


def after(law, **options):
    """Return the velocities after one step in which all three bodies approach with 1 m/s."""
    model, data = scene()
    data.qpos[:] = -1e-4 if options.get("contact_model") == "soft" else 0.0  # MuJoCo acts on overlap only
    data.qvel[:] = -1.0
    stepper = Stepper(model, law, **options)
    stepper.step(data)
    return data.qvel.copy(), stepper


@pytest.mark.parametrize("options", RIGID.values(), ids=RIGID)
def test_rigid_contacts_left_out_have_no_restitution(options):
    for chosen, wanted in (
        ({}, [0.5, 0.5, 0.5]),
        ({"limits": False}, [0.5, 0.5, 0.0]),
        ({"contacts": "*foot*"}, [0.5, 0.0, 0.5]),
        ({"contacts": ["*foot*/floor"], "limits": False}, [0.5, 0.0, 0.0]),
        ({"contacts": ["*foot*", "head/floor"], "limits": False}, [0.5, 0.5, 0.0]),
    ):
        v, stepper = after(Moreau(0.5), **options, **chosen)
        np.testing.assert_allclose(v, wanted, atol=1e-8)
        assert stepper.law == Moreau(0.5)


def test_compiled_steps_stay_compiled():
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    v, stepper = after(Moreau(0.5), scheme="time-stepping", compiled="auto", contacts="*foot*", limits=False)
    assert isinstance(stepper.stepping, TimeStepping)
    assert not stepper.stepping.law.asks
    np.testing.assert_allclose(v, [0.5, 0.0, 0.0], atol=1e-8)


def test_soft_contacts_left_out_are_mujocos():
    """Contacts left out move bit for bit as without a law; bodies are apart, so that other contacts do not matter."""
    plain, data = scene()
    data.qpos[:], data.qvel[:] = -1e-4, -1.0
    mujoco.mj_step(plain, data)
    for chosen, left_out in (
        ({"limits": False}, [KNEE]),
        ({"contacts": "*foot*"}, [HEAD]),
        ({"contacts": "*foot*", "limits": False}, [HEAD, KNEE]),
    ):
        v, stepper = after(Moreau(0.5), **SOFT, **chosen)
        labels = {label for event in stepper.events for label in event.contacts.labels}
        assert len(labels) == 3 - len(left_out)
        np.testing.assert_allclose(v[left_out], data.qvel[left_out], rtol=0, atol=1e-12)
        assert v[FOOT] > 0.4


def test_a_soft_step_in_which_only_others_close_is_mj_step():
    model, data = scene()
    reference = mujoco.MjData(model)
    data.qvel[HEAD] = reference.qvel[HEAD] = -1.0
    stepper = Stepper(model, Moreau(0.5), **SOFT, contacts="*foot*", limits=False)
    for _ in range(20):
        stepper.step(data)
        mujoco.mj_step(model, reference)
        assert stepper.events == ()
    np.testing.assert_array_equal(data.qpos, reference.qpos)


@pytest.mark.parametrize(
    ("law", "foot"),
    [
        (Newton(0.5), 0.5),
        (Newton(lambda speed: 0.5 * speed), 0.5),
        (Newton({("left_foot", "floor"): 0.5}, default=0.9), 0.5),
        (Newton({("left_foot", "floor"): 0.5}), 0.5),
        (Newton({"*foot*": 0.5}, default=0.9), 0.5),
        (Poisson(0.5), 0.5),
        (Routh(0.5), 0.5),
        (Coulomb(Moreau(0.5)), 0.5),
        (Fremond.reversal(0.5), 0.5),
        (Fremond({("left_foot/floor", "left_foot/floor"): 0.5, ("head/floor", "head/floor"): 0.9}), 0.5),
        (LinearMap(-0.5 * np.eye(3)), 0.5),
        (Compliant(1.0, restitution=0.5), 0.5),
        (AnyOutcome(seed=1), None),
    ],
    ids=repr,
)
@pytest.mark.parametrize("options", RIGID.values(), ids=RIGID)
def test_every_law(law, foot, options):
    v, _ = after(law, **options, contacts="*foot*/floor", limits=False)
    np.testing.assert_allclose(v[1:], 0.0, atol=1e-7)
    if foot is None:
        assert 0.0 < v[FOOT] < 1.0
    else:
        assert v[FOOT] == pytest.approx(foot, abs=1e-5)


def test_a_law_that_couples_contacts_knows_of_the_chosen_ones_only():
    """Reversal on two of three contacts: these exchange velocities, and the contact between them has E = 0."""
    body = '<body pos="{} 0 0"><joint type="slide" axis="1 0 0"/><geom name="b{}" size=".1" condim="1"/></body>'
    model, data = compiled("".join(body.format(0.2 * i, i) for i in range(4)), option=OPTION)
    data.qvel[:] = [1.0, 0.0, 0.0, -1.0]
    stepper = Stepper(model, Fremond.reversal(), contacts=["b0/b1", "b2/b3"], on_inadmissible="project")
    stepper.step(data)
    np.testing.assert_allclose(stepper.events[0].impact.target_contact_velocity, [1.0, 0.0, 1.0], atol=1e-12)


def test_a_law_that_is_set_later_is_for_the_same_contacts():
    model, data = scene()
    stepper = Stepper(model, Moreau(0.5), contacts="*foot*", limits=False)
    stepper.law = Moreau(0.8)
    data.qvel[:] = -1.0
    stepper.step(data)
    np.testing.assert_allclose(data.qvel, [0.8, 0.0, 0.0], atol=1e-8)
    with pytest.raises(AttributeError, match="contacts of Stepper is settled"):
        stepper.contacts = None


def test_the_rest_of_a_step_is_under_the_same_choice():
    """Time stepping of the rest of an event-driven step has the same choice: the head never bounces."""
    model, data = scene('timestep="0.01"')
    data.qpos[:] = 0.002
    stepper = Stepper(model, Moreau(0.9), contacts="*foot*", limits=False, max_events=1)
    fastest = np.zeros(3)
    for _ in range(40):
        stepper.step(data)
        fastest = np.maximum(fastest, data.qvel)
    assert stepper.unlocated > 0
    assert fastest[FOOT] > 0.1
    assert fastest[HEAD] < 1e-6


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, SOFT], ids=["event-driven", "time", "soft"])
@pytest.mark.parametrize(
    ("chosen", "error", "message"),
    [
        ({"contacts": "*feet*"}, UnknownNameError, r"contact pattern '\*feet\*'"),
        ({"contacts": ["*foot*", "head/wall"]}, UnknownNameError, "head/wall.*did you mean"),
        ({"contacts": "left_foot/head"}, UnknownNameError, "contact pattern"),  # slides are never in contact
        ({"contacts": []}, OptionError, "contacts is a pattern"),
        ({"contacts": [("left_foot", "floor")]}, OptionError, "contacts is a pattern"),
        ({"contacts": 3}, OptionError, "contacts is a pattern"),
        ({"limits": "knee"}, OptionError, "limits is True or False"),
    ],
)
def test_what_cannot_be_chosen_is_refused(options, chosen, error, message):
    world = WORLD.replace('name="head"', 'name="head" contype="2" conaffinity="2"').replace(
        'name="floor"', 'name="floor" contype="3" conaffinity="3"'
    )
    model, _ = compiled(world, option=OPTION)
    with pytest.raises(error, match=message):
        Stepper(model, Moreau(0.5), **options, **chosen)


def test_an_error_does_not_list_thousands_of_contacts():
    body = '<body pos="{} 0 1"><freejoint/><geom name="b{}" size=".1"/></body>'
    model, _ = compiled("".join(body.format(i, i) for i in range(40)))
    with pytest.raises(UnknownNameError, match="and 740 more") as raised:
        Stepper(model, Moreau(0.5), contacts="*Q*")
    assert len(str(raised.value)) < 1000


@pytest.mark.parametrize("options", RIGID.values(), ids=RIGID)
def test_a_law_with_a_rule_of_its_own_is_refused(options):
    class Own(Law):
        def target(self, collision):
            raise NotImplementedError

        def resolve(self, collision, *, solver="auto"):
            return Moreau(0.5).resolve(collision)

    with pytest.raises(RestitutionError, match="rule of its own for impulses"):
        Stepper(scene()[0], Own(), **options, limits=False)
    with pytest.raises(RestitutionError, match="rule of its own"):
        Stepper(scene()[0], Poisson([0.5, 0.5]), **options, limits=False)


def test_hopper_has_fewer_collisions_without_its_limits():
    """About half of all collisions of Hopper are at joint limits."""
    counts = []
    for limits in (True, False):
        env = gymnasium.make("Hopper-v5").unwrapped
        env.reset(seed=0)
        stepper = Stepper(env.model, Moreau(0.5), contact_model="soft", limits=limits, on_inadmissible="project")
        env.action_space.seed(0)
        events = []
        for i in range(2000):
            if i % 4 == 0:
                env.data.ctrl[:] = env.action_space.sample()
            stepper.step(env.data)
            events += stepper.events
        joints = [any("/" not in label for label in event.contacts.labels) for event in events]
        counts.append((len(joints), sum(joints)))
    assert counts[0][1] > 0.2 * counts[0][0]
    assert counts[1][0] > 0
    assert counts[1][1] == 0
