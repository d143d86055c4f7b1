"""Comparison of one scene under several laws and under MuJoCo's soft contacts."""

import inspect
import math
import time

import mujoco
import numpy as np
import pytest

from impactlaw import Collision, Stepper
from impactlaw.cli import Compare
from impactlaw.comparison.compare import DEFAULT_LAWS, Comparison, choose_laws, compare, format_table
from impactlaw.comparison.runs import run_law
from impactlaw.comparison.soft_contact import soft_outcome, tuned_contacts
from impactlaw.errors import ImpactLawError, RestitutionError, SceneError, UnknownNameError
from impactlaw.laws import LAWS, Moreau
from impactlaw.models import SCENES, load
from impactlaw.recording import read_log


@pytest.fixture(scope="module")
def cradle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cradle")
    return folder, compare(Comparison(scene="newtons_cradle", duration=0.1), folder).set_index("run")


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ("maximal-dissipation", [0.2, 0.2, 0.2, 0.2, 0.2]),
        ("moreau", [-0.6, 0.4, 0.4, 0.4, 0.4]),
        ("reversal", [0.0, 0.0, 0.0, 0.0, 1.0]),
    ],
)
def test_the_cradle_leaves_its_first_collision_as_the_law_says(cradle, law, expected):
    row = cradle[1].loc[law]
    assert row["v+"] == pytest.approx(expected, abs=1e-12)
    assert row["admissible"] == "yes"
    assert row["distance from S"] < 1e-12
    assert row["events"] == 1


def test_mujoco_outcome_of_the_cradle_is_audited_against_the_same_set(cradle):
    model, start = load("newtons_cradle")
    collision = Collision.from_mujoco(model, start)
    for run in ("mujoco", "mujoco-tuned"):
        row = cradle[1].loc[run]
        outside = collision.admissible_set.distance(row["v+"])
        assert row["distance from S"] == pytest.approx(outside, rel=1e-6)
        assert outside > 1e-3  # gravity and the duration of the contact lead out of the set of instantaneous jumps
        assert row["admissible"] != "yes"
        assert np.isnan(row["events"])
        assert row["penetration"] > 1e-3


def test_the_kinetic_violation_of_mujoco_on_the_cradle_is_gravity_during_contact():
    """As the README says: 0.02 of |v-| with gravity, nearly nothing without."""
    model, start = load("newtons_cradle")
    impact = Moreau(1.0).resolve(Collision.from_mujoco(model, start))
    kinetic = []
    for gravity in (-9.81, 0.0):
        model.opt.gravity[2] = gravity
        kinetic.append(soft_outcome(model, start, impact).violations.kinetic / impact.collision.pre_speed)
    assert kinetic == [pytest.approx(0.0195, abs=1e-3), pytest.approx(0.0, abs=1e-4)]


def test_antidissipative_contacts_of_the_reversal_are_named(cradle):
    assert cradle[1].loc["reversal", "antidissipative"] == "ball4/ball5"
    assert cradle[1].loc["moreau", "antidissipative"] == ""


def test_everything_is_written_and_reads_back(cradle):
    folder, table = cradle
    names = {path.name for path in folder.iterdir()}
    assert names == {"table.csv", "picture.png", *(f"{run}.rrd" for run in table.index)}
    collisions = read_log(folder / "reversal.rrd").collisions
    assert len(collisions) == table.loc["reversal", "events"]


def test_the_table_on_screen_has_a_line_per_run(cradle):
    text, _, below = format_table(cradle[1].reset_index()).partition("\n\n")
    assert len(text.splitlines()) == 1 + len(cradle[1])
    laws, caution = below.splitlines()
    assert laws == (
        "laws: maximal-dissipation = MaximalDissipation(), moreau = Moreau(restitution=1.0), "
        "reversal = Reversal(restitution=1.0)"
    )
    assert "what gravity does meanwhile is part of v+" in caution
    assert "(0, 0, 0, 0, 1)" in text
    assert "(-0.6, 0.4, 0.4, 0.4, 0.4)" in text


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_compares(scene, tmp_path):
    table = compare(Comparison(scene=scene, laws=("moreau",), duration=0.4), tmp_path)
    moreau = table.set_index("run").loc["moreau"]
    assert not moreau["refused"]
    assert moreau["penetration"] <= 1e-9
    assert moreau["unlocated"] == 0
    assert moreau["energy kept"] <= 1.0 + 1e-4


def test_the_first_collision_of_the_rod_has_its_exact_answer(tmp_path):
    table = compare(Comparison(scene="falling_rod", duration=1.1), tmp_path).set_index("run")
    assert table.loc["scene", "T+/T-"] == pytest.approx(1 / 3, abs=1e-9)
    assert table.loc["moreau", "admissible"] == "yes"


def test_a_law_that_creates_energy_is_refused_and_the_others_run(tmp_path):
    table = compare(Comparison(scene="ball_stack", laws=("moreau", "reversal"), duration=0.6), tmp_path)
    table = table.set_index("run")
    assert "energy ratio" in table.loc["reversal", "refused"]
    assert not table.loc["moreau", "refused"]
    assert "reversal was refused" in format_table(table.reset_index())


@pytest.mark.parametrize("restitution", [0.05, 0.2, 0.5, 0.9, 1.0])
def test_tuned_soft_contacts_bounce_with_about_their_restitution(restitution):
    model, data = load("bouncing_ball")
    model.opt.gravity[:] = 0.0
    data.qpos[:] = 0.0
    data.qvel[:] = -3.0
    collision = Collision.from_mujoco(model, data)
    soft = soft_outcome(tuned_contacts(model, restitution), data, Moreau(restitution).resolve(collision))
    e = -soft.post_contact_velocity[0] / collision.pre_contact_velocity[0]
    assert e == pytest.approx(restitution, abs=0.05)
    assert abs(e - restitution) > 1e-6  # MuJoCo's tuned contacts are not exact, unlike the laws


def test_tuning_leaves_the_scene_alone():
    model, _ = load("bouncing_ball")
    before = model.opt.o_solref.copy(), model.opt.enableflags
    tuned_contacts(model, 0.5)
    assert (model.opt.o_solref == before[0]).all()
    assert model.opt.enableflags == before[1]


def test_default_laws_hold_the_scene_law_only_where_it_differs_between_pairs():
    assert "scene" not in choose_laws(load("newtons_cradle")[0], None, 1.0)
    assert "scene" in choose_laws(load("falling_rod")[0], None, 1.0)


def test_the_restitution_is_that_of_every_law_that_takes_one(tmp_path):
    names = tuple(name for name in LAWS if name != "fremond")
    laws = choose_laws(load("ball_chain")[0], names, 0.5)
    assert {name: getattr(law, "restitution", None) for name, law in laws.items()} == {
        "maximal-dissipation": None,
        "moreau": 0.5,
        "newton": 0.5,
        "poisson": 0.5,
        "reversal": 0.5,
        "routh": 0.5,
        "compliant": 0.5,
        "any-outcome": None,
    }
    table = compare(Comparison(scene="ball_chain", laws=("reversal",), restitution=0.5, duration=0.02), tmp_path)
    assert table.set_index("run").loc["reversal", "v+"] == pytest.approx([1 / 6, 1 / 6, 2 / 3])
    assert table.set_index("run").loc["reversal", "law"] == "Reversal(restitution=0.5)"
    assert read_log(tmp_path / "reversal.rrd").properties["restitution"] == 0.5


def test_the_help_names_the_laws_that_run():
    text = inspect.getsource(Comparison)  # whose fields are the options of the command
    assert issubclass(Compare, Comparison)
    assert "maximal-dissipation, moreau, reversal, and scene if" in text
    assert DEFAULT_LAWS == ("maximal-dissipation", "moreau", "scene", "reversal")


def test_scene_without_restitution_has_no_law_of_its_own():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    with pytest.raises(RestitutionError, match="carries no restitution"):
        choose_laws(model, ("scene",), 1.0)


@pytest.mark.parametrize(
    ("study", "error", "message"),
    [
        ({"scene": "newtons_cradel"}, UnknownNameError, "newtons_cradle"),
        ({"laws": ("moro",)}, UnknownNameError, "moreau"),
        ({"laws": ("fremond",)}, RestitutionError, "matrix"),
        ({"laws": ()}, RestitutionError, "laws is empty: there is nothing to compare; choose from [^;]*poisson, rev"),
        ({"laws": ("scene", "any-outcome"), "restitution": 0.5}, RestitutionError, "none takes a restitution, got 0.5"),
        ({"restitution": -0.1}, RestitutionError, "-0.1"),
        ({"restitution": math.nan}, RestitutionError, "nan"),
        ({"duration": 0.0}, ImpactLawError, "duration"),
        ({"timestep": math.inf}, ImpactLawError, "timestep"),
        ({"timestep": 5e-324}, SceneError, "takes more than 1e[+]12 timesteps"),
        ({"duration": 1e308}, SceneError, "takes more than 1e[+]12 timesteps"),
    ],
)
def test_wrong_input_is_named_and_nothing_is_written(study, error, message, tmp_path):
    with pytest.raises(error, match=message):
        compare(Comparison(**study), tmp_path)
    assert not list(tmp_path.iterdir())


def test_soft_outcome_on_a_mocap_body_that_was_moved():
    """MuJoCo's contacts act at the current place of the surface: the ball comes back according to their tuning."""
    model, data = load("juggler")
    data.mocap_pos[0, 2] = data.qpos[0] = 0.3
    data.qvel[0] = -4.0
    collision = Collision.from_mujoco(model, data)
    soft = soft_outcome(tuned_contacts(model, 0.8), data, Moreau(0.8).resolve(collision))
    assert soft.post_velocity == pytest.approx([3.2], abs=0.1)


@pytest.mark.parametrize("pair", ["", '<contact><pair geom1="floor" geom2="block" friction=".3 .3"/></contact>'])
def test_tuned_contacts_have_the_friction_of_the_scene(pair):
    block = '<body pos="0 0 .1"><freejoint/><geom name="block" type="box" size=".1 .1 .1" friction=".3"/></body>'
    model = tuned_contacts(
        mujoco.MjModel.from_xml_string(
            '<mujoco><option timestep="0.001" cone="elliptic" impratio="100"/><worldbody>'
            f'<geom name="floor" type="plane" size="9 9 1" friction=".3"/>{block}</worldbody>{pair}</mujoco>'
        ),
        0.0,
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert data.qvel[0] == pytest.approx(2.0 - 0.3 * 9.81 * 0.3, abs=0.05)


def test_the_time_of_a_step_is_without_that_of_loading_the_compiled_solver(monkeypatch):
    model, start = load("box_drop")
    step, loaded = Stepper.step, []

    def first_loads(self, data):
        if not loaded:
            loaded.append(time.sleep(1.0))
        step(self, data)

    monkeypatch.setattr(Stepper, "step", first_loads)
    assert 0.0 < run_law(model, start, "moreau", Moreau(0.5), 3).seconds_per_step < 0.3  # a third of it would be longer


DRIVEN = """<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody>
  <body pos="0 0 0"><joint name="rail" type="slide" axis="1 0 0" range="-1 .1" limited="true"/>
    <geom name="the cart" size=".05" mass="1"/></body></worldbody>
  <actuator><motor joint="rail" gear="{gear}"/></actuator>
  <keyframe><key name="start" qpos=".09" qvel="1" ctrl="1"/></keyframe></mujoco>"""


@pytest.mark.parametrize("gear", [0.0, 20.0])
def test_mujocos_outcome_is_under_the_controls_of_the_scene(tmp_path, gear):
    """A cart hits the end of its rail while a motor pushes it: with 20 N MuJoCo's contact does not return e = 0.5."""
    scene = tmp_path / "cart.xml"
    scene.write_text(DRIVEN.format(gear=gear))
    table = compare(Comparison(scene=str(scene), duration=0.3, restitution=0.5, laws=("moreau",)), tmp_path)
    after = {row["run"]: row["v+"][0] for _, row in table.iterrows()}
    assert after["moreau"] == pytest.approx(-0.5 * math.sqrt(1.0 + 2.0 * 0.01 * gear), rel=0.02)
    if gear == 0.0:
        assert after["mujoco-tuned"] == pytest.approx(-0.5, abs=0.05)  # limits are tuned, too
        assert after["mujoco"] > -0.2  # critically damped
    else:
        assert after["mujoco"] > -0.05


def test_mujocos_outcome_is_that_of_the_collision_however_long_the_run_goes_on(tmp_path):
    """MuJoCo's outcome starts with the activations of the start; those of the end grow with the run."""
    scene = tmp_path / "cart.xml"
    motor = '<general joint="rail" dyntype="integrator" gainprm="400"/>'
    scene.write_text(DRIVEN.replace('<motor joint="rail" gear="{gear}"/>', motor))
    found = []
    for duration in (0.05, 1.0):
        study = Comparison(scene=str(scene), duration=duration, restitution=0.5, laws=("moreau",))
        found.append([row["v+"][0] for _, row in compare(study, tmp_path).iterrows()])
    assert found[0] == pytest.approx(found[1], abs=1e-12)


ABOVE = """<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body pos="0 0 .15"><freejoint/><geom name="the lower/ball" size=".1" mass="1"/></body>
  <body pos="0 0 .37"><freejoint/><geom name="the upper" size=".1" mass="1"/></body></worldbody></mujoco>"""


def test_mujocos_outcome_ends_with_the_contacts_that_collide():
    """A ball above hits the lower one while it rebounds: this is another collision."""
    model = mujoco.MjModel.from_xml_string(ABOVE)
    data = mujoco.MjData(model)
    run = run_law(model, data, "moreau", Moreau(1.0), 80)
    assert run.first is not None
    assert run.first.collision.labels == ("floor/the lower/ball",)
    data.qpos[:] = run.qpos
    outcome = soft_outcome(tuned_contacts(model, 1.0), data, run.first)
    assert outcome.post_velocity[2] == pytest.approx(-outcome.collision.pre_velocity[2], rel=0.1)
    assert outcome.post_velocity[8] < outcome.collision.pre_velocity[8]  # it keeps falling


def test_names_with_blanks_dollars_and_underscores(tmp_path):
    scene = tmp_path / "odd.xml"
    text = ABOVE.replace("the lower/ball", "a$\\frac$b c").replace("<freejoint/>", '<freejoint name="_free"/>', 1)
    scene.write_text(text)
    table = compare(Comparison(scene=str(scene), duration=0.2, restitution=1.0), tmp_path)
    assert (tmp_path / "picture.png").stat().st_size > 0
    table["antidissipative"] = "floor/a$\\frac$b c"
    assert "floor/a$\\frac$b c " in format_table(table)
    table["antidissipative"] = "floor/a b; floor/c d"
    assert "floor/a b and 1 more" in format_table(table)


def test_what_has_no_energy_to_keep_keeps_it_all(tmp_path):
    scene = tmp_path / "still.xml"
    scene.write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 1"/>'
        '<body pos="0 0 .2"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    table = compare(Comparison(scene=str(scene), laws=("moreau",), duration=0.02), tmp_path)
    assert (table["energy kept"] == 1.0).all()
