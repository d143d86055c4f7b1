"""Restitution as a function of the speed at which a contact closes."""

import math
import pickle

import mujoco
import numpy as np
import pytest
from problems import PROBLEMS, launched, rod
from scenes import compiled

from impactlaw import Collision, Newton, Poisson, Stepper, make_law
from impactlaw.errors import RestitutionError
from impactlaw.recording import Recorder, read_log

G = 9.81
EXACT = {"rtol": 0, "atol": 1e-12}
HALF = 3.0  # m/s


def softening(speed: float) -> float:
    """Return 1 for slow contacts, 1/2 at `HALF`: the speed after is ``u / (1 + u / HALF)``, so 1/u grows by 1/HALF."""
    return 1.0 / (1.0 + speed / HALF)


def johnson(speed: float) -> float:
    """Return ``(u / u_0)^(-1/4)`` above the speed u_0 at which steel starts to yield: 0.1 m/s."""
    return (0.1 / max(speed, 0.1)) ** 0.25


# --- what the function is called with --------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [Newton, Poisson])
def test_the_function_gets_the_closing_speed_of_each_contact(law):
    seen = []

    def restitution(speed):
        assert type(speed) is float
        seen.append(speed)
        return 0.5

    c = Collision(np.eye(3), np.diag([1.0, 2.0, 1.0]), [-1.0, -2.0, 3.0])
    e = law(restitution).coefficients(c)
    assert seen == [1.0, 4.0, 0.0]  # the third contact opens
    np.testing.assert_array_equal(e, [0.5, 0.5, 0.5])
    seen.clear()
    moving = Collision([[1.0]], [[1.0]], [-1.0], surface_velocity=[-0.25], post_surface_velocity=[-3.0])
    law(restitution).resolve(moving)
    assert seen == [1.25 if law is Newton else 4.0]  # Poisson's compression starts after the jump of the surface


@pytest.mark.parametrize("law", [Newton, Poisson])
@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_a_constant_function_is_a_constant(problem_name, law):
    c = PROBLEMS[problem_name]()
    variable, constant = law(lambda speed: 0.4).resolve(c), law(0.4).resolve(c)
    np.testing.assert_array_equal(variable.post_velocity, constant.post_velocity)


def test_in_place_of_any_number():
    c = Collision(np.eye(3), np.eye(3), [-1.0, -3.0, -6.0], labels=("a/floor", "b/floor", "c/floor"))
    e = [0.75, 0.5, 1 / 3]
    np.testing.assert_allclose(Newton(softening).coefficients(c), e, **EXACT)
    np.testing.assert_allclose(Newton([softening, 0.9, softening]).coefficients(c), [e[0], 0.9, e[2]], **EXACT)
    keyed = Newton({("floor", "a"): softening, "b/floor": 0.9}, default=softening)
    np.testing.assert_allclose(keyed.coefficients(c), [e[0], 0.9, e[2]], **EXACT)
    assert keyed.contact_labels == {"a/floor", "b/floor"}
    np.testing.assert_allclose(make_law("newton", softening).resolve(c).post_velocity, [0.75, 1.5, 2.0], **EXACT)
    np.testing.assert_allclose(make_law("poisson", softening).resolve(c).post_velocity, [0.75, 1.5, 2.0], **EXACT)


def test_rod_that_falls_tilting():
    """Ends that close with 1 and 3 m/s: e = (3/4, 1/2), and gamma+ = -e gamma- under Newton's law; both ends press."""
    c = Collision(rod().mass_matrix, rod().jacobian, [-2.0, -1.0])
    np.testing.assert_allclose(c.pre_contact_velocity, [-1.0, -3.0], **EXACT)
    impact = Newton(softening).resolve(c)
    np.testing.assert_allclose(impact.post_contact_velocity, [0.75, 1.5], **EXACT)
    np.testing.assert_allclose(impact.impulse, np.linalg.solve(c.delassus, [1.75, 4.5]), **EXACT)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda speed: 1.2, r"contact 0 at speed 1 must lie in \[0, 1\], got 1.2"),
        (lambda speed: -0.1, "at speed 1 must lie in"),
        (lambda speed: math.nan, r"must lie in \[0, 1\], got nan"),
        (lambda speed: None, "must be a number in"),
        (lambda speed: (-speed) ** 0.25, "must be a number in"),
        (lambda speed: 1.0 / (speed - 1.0), "contact 0 at speed 1 cannot be computed: float division by zero"),
        (lambda: 0.5, "contact 0 at speed 1 cannot be computed: .* takes 0 positional arguments but 1 was given"),
    ],
)
def test_wrong_functions(function, message):
    with pytest.raises(RestitutionError, match=message):
        Newton(function).resolve(launched(3, 1))
    with pytest.raises(RestitutionError, match=message):
        Poisson({"0": function}, default=0.5).resolve(launched(3, 1))


@pytest.mark.parametrize("name", ["moreau", "reversal", "fremond"])
def test_other_laws_take_no_function(name):
    with pytest.raises(RestitutionError, match=r"must be a number|needs a restitution matrix"):
        make_law(name, softening)


# --- a law is a value ------------------------------------------------------------------------------------------------


def test_a_law_with_a_function_is_still_a_value():
    law = Newton(softening)
    assert law == Newton(softening)
    assert law != Newton(johnson)
    assert law != Poisson(softening)
    assert hash(law) == hash(Newton(softening))
    assert hash(Newton((0.5, softening))) == hash(Newton((0.5, softening)))
    name = f"{__name__}.softening"
    assert repr(law) == f"Newton(restitution={name}, default=None)"
    keyed = Poisson({"b/a": softening, "c/d": 0.5}, default=softening)
    assert repr(keyed) == f"Poisson(restitution={{'a/b': {name}, 'c/d': 0.5}}, default={name})"
    assert repr(Newton((0.5, softening))) == f"Newton(restitution=(0.5, {name}), default=None)"
    assert pickle.loads(pickle.dumps(Newton(math.cos))) == Newton(math.cos)
    assert repr(Newton(math.cos)) == "Newton(restitution=math.cos, default=None)"


@pytest.mark.parametrize(
    ("law", "restitution"),
    [
        (Newton(softening), f"{__name__}.softening"),
        (Poisson([0.25, softening]), [0.25, f"{__name__}.softening"]),
        (Newton({"a/b": softening, "c/d": 0.5}), {"a/b": f"{__name__}.softening", "c/d": 0.5}),
    ],
)
def test_recording_names_the_function(tmp_path, law, restitution):
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    Recorder(model, tmp_path / "run.rrd", law=law).close()
    properties = read_log(tmp_path / "run.rrd").properties
    assert properties["law"] == repr(law)
    assert properties["restitution"] == restitution


# --- motion ----------------------------------------------------------------------------------------------------------


def ball(timestep: float, integrator: str = "RK4", height: float = 1.0):
    world = f"""<geom name="floor" type="plane" size="1 1 1" condim="1"/>
        <body pos="0 0 {0.1 + height}"><joint type="slide" axis="0 0 1"/>
        <geom name="ball" size=".1" condim="1"/></body>"""
    return compiled(world, option=f'timestep="{timestep}" integrator="{integrator}"')


def flights(speeds, height=1.0):
    """Return the height over time of a ball that is dropped and leaves the ground with these speeds."""
    start = [math.sqrt(2 * height / G)]
    for u in speeds:
        start.append(start[-1] + 2 * u / G)

    def at(t):
        if t < start[0]:
            return height - 0.5 * G * t * t
        k = int(np.searchsorted(start, t, side="right")) - 1
        return speeds[k] * (t - start[k]) - 0.5 * G * (t - start[k]) ** 2

    return at


def assert_flies(law, at):
    """Assert that 3 s of rigid steps follow these heights."""
    model, data = ball(0.05)
    stepper, collisions = Stepper(model, law), 0
    for _ in range(60):
        stepper.step(data)
        collisions += len(stepper.events)
        assert data.qpos[0] + 1.0 == pytest.approx(at(data.time), abs=1e-9)
    assert collisions > 8


@pytest.mark.parametrize("law", [Newton, Poisson])
def test_bouncing_ball_of_harmonic_speeds(law):
    """1/u grows by 1/HALF at each impact, so that the heights are ``u_0^2 / 2 g (1 + k u_0 / HALF)^2``."""
    fall = math.sqrt(2 * G)
    at = flights([fall / (1 + k * fall / HALF) for k in range(1, 400)])
    assert_flies(law(softening), at)


def test_bouncing_ball_of_johnson():
    """``u_k = u_0^((3/4)^k) 0.1^(1 - (3/4)^k)``: always above 0.1 m/s, below which it would be elastic."""
    fall = math.sqrt(2 * G)
    at = flights([fall ** (0.75**k) * 0.1 ** (1 - 0.75**k) for k in range(1, 400)])
    assert_flies(Newton(johnson), at)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "discrete", "RK4"])
def test_soft_steps_give_each_collision_its_own_coefficient(integrator):
    """It is exact for the speed at the start of the step; over the motion it is of first order in the timestep."""
    errors = []
    for timestep in (1e-3, 2.5e-4):
        model, data = ball(timestep, integrator)
        stepper, speeds = Stepper(model, Newton(softening), contact_model="soft"), []
        while len(speeds) < 4:
            stepper.step(data)
            for event in stepper.events:
                (before,), (after,) = event.impact.collision.pre_contact_velocity, event.impact.post_contact_velocity
                assert after == pytest.approx(-before / (1 - before / HALF), rel=1e-12)
                speeds.append(-before)
        fall = math.sqrt(2 * G)
        expected = [fall / (1 + k * fall / HALF) for k in range(4)]
        errors.append(np.abs(np.array(speeds) - expected).max() / timestep)
    assert max(errors) < 4 * G  # velocity that gravity adds per step, at each of four collisions
