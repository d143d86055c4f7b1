"""Bodies that jam do not end a run of soft steps; a law that does not fit its contacts does."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from scenes import CLOSING, HELD
from scenes import compiled as compile_scene

from impactlaw import Fremond, Moreau, Stepper
from impactlaw.envs import ImpactLaw
from impactlaw.errors import SolverError, UnsolvableLawError
from impactlaw.solvers.friction import solve

JAM = (
    (-8.756441491107173, -0.5294397993016361, 3.446350937151604, 0.4032184000507698, -0.3269331208193089,
     -0.008362221697740022, 0.27571687676287643, 0.36444716320914206, 0.09693485059105762),
    (0.25977730331245696, -1.549247649343238, 3.877177114182032, -4.074811278541012, -13.308072276621568,
     11.739245103330694, -11.763683576082812, 5.911472684886507, 0.16368325580040494),
)  # fmt: skip
"""A HalfCheetah under random actions, on its back: torso and thigh touch the floor."""


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_mujoco_takes_a_step_without_a_solution(compiled):
    model = mujoco.MjModel.from_xml_string(HELD.format(arm=10))
    data, bare = mujoco.MjData(model), mujoco.MjData(model)
    data.qvel[:] = bare.qvel[:] = CLOSING
    stepper = Stepper(model, Moreau(0.0), contact_model="soft", compiled=compiled)
    assert stepper.short_steps == 0
    stepper.step(data)
    mujoco.mj_step(model, bare)
    assert stepper.short_steps == 1
    assert not stepper.events
    assert (data.qvel == bare.qvel).all()
    data.qvel[0] = 0.0
    stepper.step(data)
    assert stepper.short_steps == 1


def jammed():
    model = gym.make("HalfCheetah-v5").unwrapped.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = JAM
    return model, data


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_impulses_are_found_from_inside_of_the_cones(compiled):
    model, data = jammed()
    stepper = Stepper(model, Moreau(0.0), contact_model="soft", compiled=compiled)
    stepper.step(data)
    assert stepper.short_steps == 0
    (event,) = stepper.events
    assert event.impact.residual < 1e-9
    assert event.impact.violations.is_admissible()


@pytest.mark.parametrize(("scene", "e"), [("jam", 0.0), ("jam", 0.5), ("slider", 0.5)])
def test_no_problem_is_solved_twice(scene, e, monkeypatch):
    """Nor is it solved twice from the same start; a step that loses its restitution is counted."""
    asked, answer = [], solve.compiled_answer

    def once(problem, guess, rounds, **options):
        scaled = None if guess is None else problem.scaled(guess)
        asked.append(b"".join(np.asarray(a, float).tobytes() for a in (problem.rows, problem.start + 0.0, scaled)))
        asked[-1] += bytes([problem.exact, rounds])
        return answer(problem, guess, rounds, **options)

    monkeypatch.setattr(solve, "compiled_answer", once)
    model, data = jammed() if scene == "jam" else slider()
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled="never")
    stepper.step(data)
    assert stepper.short_steps == (scene == "slider")
    assert asked
    assert len(set(asked)) == len(asked)


def test_an_environment_tells_such_steps(tmp_path):
    xml = tmp_path / "held.xml"
    xml.write_text(HELD.format(arm=10))
    robot = gym.make("HalfCheetah-v5", xml_file=str(xml), frame_skip=1)
    env = ImpactLaw(robot, law="moreau", restitution=0.0)
    assert env.reset(seed=0)[1]["impact/short"] == 0
    env.unwrapped.set_state(np.zeros(4), np.array(CLOSING))
    still = np.zeros(env.action_space.shape)
    assert env.step(still)[4]["impact/short"] == env.stepper.short_steps == 1
    env.unwrapped.set_state(np.zeros(4), np.zeros(4))
    assert env.step(still)[4]["impact/short"] == 0


COUPLED = """<body><joint name="knob" axis="0 0 1" range="0 60"/><geom size=".1"/></body>
    <body pos="1 0 0"><joint name="slide" type="slide" range="-1 0"/><geom size=".1"/></body>"""
COUPLING = '<equality><joint joint1="knob" joint2="slide" polycoef="0 1 0 0 0"/></equality>'
"""A knob coupled to a slide: their limits close against each other."""


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_constraint_that_gives_way_lets_limits_act(e):
    model, data = compile_scene(COUPLED, COUPLING, option='gravity="0 0 0"')
    data.qpos[:], data.qvel[:] = (-1e-3, 1e-3), (-1.0, 1.0)  # violates the coupling
    stepper = Stepper(model, Moreau(e), contact_model="soft")
    stepper.step(data)
    impact = stepper.events[0].impact
    np.testing.assert_allclose(impact.post_contact_velocity, [e, e], atol=1e-9)
    assert stepper.short_steps == 0
    assert abs(data.qvel).max() < 2.0


def test_a_law_that_does_not_fit_is_still_told():
    """The law lifts a block that a ball hits; a rope would push the body at its other end into the floor."""
    world = """<geom name="floor" type="plane" size="9 9 1"/>
        <body pos="0 0 .1"><joint name="a" type="slide" axis="0 0 1"/><geom name="block" size=".1"/></body>
        <body pos="1 0 .1"><joint name="b" type="slide" axis="0 0 1"/><geom name="other" size=".1"/></body>
        <body pos="0 0 .3"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1"/></body>"""
    rope = '<equality><joint joint1="a" joint2="b" polycoef="0 -1 0 0 0"/></equality>'
    model, data = compile_scene(world, rope, geom='condim="1"')
    data.qpos[:], data.qvel[:] = (-1e-4, -1e-4, -4e-4), (0.0, 0.0, -1.0)
    law = Fremond({("floor/block", "block/ball"): 1.0})
    with pytest.raises(UnsolvableLawError, match="floor/block"):
        Stepper(model, law, contact_model="soft").step(data)


def slider(world=""):
    """Return a ball on a slide that hits the floor at 30 degrees: friction of 1 lets it stop, but not return."""
    model, data = compile_scene(
        f"""<geom type="plane" size="9 9 1"/><body pos="0 0 .0999"><joint type="slide" axis="-.866 0 .5"/>
        <geom name="jammed" size=".1" mass="1"/></body>{world}""",
        geom='friction="1"',
        option='gravity="0 0 0"',
    )
    data.qvel[0] = -2.0
    return model, data


@pytest.mark.parametrize("e", [0.3, 1.0])
def test_restitution_that_has_no_solution_is_not_searched_for_long(e, monkeypatch):
    steps, answer = [], solve.compiled_answer

    def counted(problem, guess, rounds, **options):
        found = answer(problem, guess, rounds, **options)
        steps.append(found[1])
        return found

    monkeypatch.setattr(solve, "compiled_answer", counted)
    model, data = slider()
    stepper = Stepper(model, Moreau(e), contact_model="soft", compiled="never")
    stepper.step(data)
    assert stepper.short_steps == 1
    assert abs(data.qvel[0]) < 0.01
    assert 0 < sum(steps) < 800


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_bodies_that_jam_leave_others_their_restitution(compiled):
    """There are many contacts, and those of other bodies are separate problems."""
    boxes = "".join(
        f'<body pos="{x} 0 .0999"><freejoint/><geom name="{x}" type="box" size=".1 .1 .1"/></body>' for x in (2, 4, 6)
    )
    model, data = slider(boxes)
    data.qvel[3::6] = -2.0
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    stepper.step(data)
    assert stepper.short_steps == 1
    assert abs(data.qvel[0]) < 0.01
    np.testing.assert_allclose(data.qvel[3::6], 1.0, atol=1e-9)


BOXES = "".join(f'<body pos="{i} 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>' for i in range(30))


@pytest.mark.parametrize(("part", "work"), [("gap_gradients", 0.5), ("Closed.coupled", 1.5)])
def test_what_takes_too_much_work_is_not_begun(part, work, monkeypatch):
    """Regression: dense matrices of thousands of degrees of freedom took 10 s before the work was found too much."""
    module = "impactlaw.stepping.collisions." if "." in part else "impactlaw.stepping.soft.collisions."
    monkeypatch.setattr("impactlaw.stepping.soft.collisions.WORK", work)
    monkeypatch.setattr(module + part, lambda *_: pytest.fail("it is built all the same"))
    model, data = compile_scene('<geom type="plane" size="40 9 1"/>' + BOXES)
    data.qvel[2:90:6], data.qvel[92::6] = -2.0, -1e-3
    bare = mujoco.MjData(model)
    bare.qpos[:], bare.qvel[:] = data.qpos, data.qvel
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    stepper.step(data)
    mujoco.mj_step(model, bare)
    assert stepper.short_steps == 1
    assert np.array_equal(data.qvel, bare.qvel)


class NeverFound(Moreau):
    """A law for which no impulses in the friction cones are found with restitution."""

    def target(self, collision):
        raise SolverError("none were found")


def test_a_collision_without_a_solution_has_no_restitution():
    """With friction one of several collisions of a step may have no solution, though each has one with e = 0."""
    world = """<geom name="floor" type="plane" size="9 9 1"/>
        <body pos="0 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>"""
    model, data = compile_scene(world)
    data.qvel[:3] = 1.0, 0.0, -1.0
    stepper = Stepper(model, NeverFound(0.5), contact_model="soft", compiled="never")
    stepper.step(data)
    assert stepper.short_steps == 1
    (event,) = stepper.events
    np.testing.assert_allclose(event.impact.post_contact_velocity, 0.0, atol=1e-9)
    stepper.step(data)
    assert stepper.short_steps == 1


@pytest.mark.parametrize(("work", "some"), [(200.0, False), (1.0, True)])
def test_what_takes_too_much_work_is_left_to_mujoco_and_counted(work, some, monkeypatch):
    """Four corners of a box with friction take some units of work, both with and without restitution."""
    monkeypatch.setattr("impactlaw.stepping.soft.collisions.WORK", work)
    model, data = compile_scene(
        '<geom type="plane" size="9 9 1"/><body pos="0 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    )
    data.qvel[:3] = 0.5, 0.2, -2.0
    bare = mujoco.MjData(model)
    bare.qpos[:], bare.qvel[:] = data.qpos, data.qvel
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    stepper.step(data)
    mujoco.mj_step(model, bare)
    assert stepper.short_steps == some
    assert (len(stepper.events) == 0) == some
    assert np.array_equal(data.qvel, bare.qvel) == some
