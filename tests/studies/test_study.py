"""How studies are stated: laws as texts, and no option that is accepted but ignored."""

import json

import numpy as np
import pytest

from impactlaw import Moreau
from impactlaw.errors import ImpactLawError, RestitutionError, StudyError, UnknownNameError
from impactlaw.laws import portable
from impactlaw.studies import Study, run
from impactlaw.studies.environments import Conditions
from impactlaw.studies.laws import read_law
from impactlaw.studies.play import play

JUGGLER = "impactlaw/Juggler-v0"


def test_a_text_states_a_law():
    assert read_law("moreau:0.5").distribution().examples() == [{"law": "moreau", "restitution": 0.5}]
    assert read_law("maximal-dissipation").distribution().examples() == [{"law": "maximal-dissipation"}]
    assert read_law("mujoco").is_mujoco


def test_a_range_and_several_names_are_drawn_from_uniformly():
    law, rng = read_law("moreau|reversal:0.4..1"), np.random.default_rng(0)
    drawn = [law.distribution().draw(rng) for _ in range(4000)]
    e = np.array([one["restitution"] for one in drawn])
    assert law.is_drawn
    assert 0.4 <= e.min() < 0.41
    assert 0.99 < e.max() <= 1.0
    assert e.mean() == pytest.approx(0.7, abs=4 * 0.6 / np.sqrt(12 * 4000))
    assert sum(one["law"] == "moreau" for one in drawn) == pytest.approx(2000, abs=4 * np.sqrt(1000))


def test_a_law_that_takes_no_restitution_is_drawn_without():
    law, rng = read_law("moreau|maximal-dissipation:0.4..1"), np.random.default_rng(0)
    drawn = [law.distribution().draw(rng) for _ in range(50)]
    assert {one["law"] for one in drawn} == {"moreau", "maximal-dissipation"}
    assert all(("restitution" not in one) == (one["law"] == "maximal-dissipation") for one in drawn)


def test_a_file_of_identification_is_a_law(tmp_path):
    path = tmp_path / "law.json"
    path.write_text(json.dumps({"law": portable(Moreau(0.3))}))
    env = Conditions(JUGGLER, read_law(str(path)), "event-driven").make()
    _, info = env.reset(seed=0)
    assert info["impact/restitution"] == 0.3
    env.close()


def test_the_law_of_each_episode_is_drawn_and_the_seed_settles_it():
    env = Conditions(JUGGLER, read_law("moreau:0.4..1"), "event-driven").make()

    def episodes():
        return [env.reset(seed=seed)[1]["impact/restitution"] for seed in (3, None, None)]

    first = episodes()
    assert len(set(first)) == 3
    assert episodes() == first
    env.close()


@pytest.mark.parametrize("scheme", ["soft", "time-stepping", "event-driven"])
def test_a_task_of_others_is_under_the_law_in_the_way_that_is_asked_for(scheme):
    env = Conditions("Hopper-v5", read_law("moreau:0.5"), scheme).make()
    env.reset(seed=0)
    assert env.get_wrapper_attr("contact_model") == ("soft" if scheme == "soft" else "rigid")
    assert env.get_wrapper_attr("scheme") == (None if scheme == "soft" else scheme)
    assert env.get_wrapper_attr("law") == Moreau(0.5)
    env.close()


def test_mujocos_own_contacts_are_those_without_a_wrapper():
    env = Conditions("Hopper-v5", read_law("mujoco"), "soft").make()
    assert "impact/law" not in env.reset(seed=0)[1]
    env.close()


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", StudyError, "moreau:0.5"),
        ("moro:0.5", UnknownNameError, "'moreau'"),
        ("moreau:1.5", RestitutionError, r"\[0, 1\]"),
        ("moreau:0.4..1.5", RestitutionError, r"\[0, 1\]"),
        ("moreau:half", StudyError, "neither a number nor a range"),
        ("moreau:nan", StudyError, "a restitution is a finite number, got 'nan'"),
        ("moreau:", StudyError, "neither a number nor a range"),
        ("moreau:1..0.4", StudyError, "lower to a higher"),
        ("mujoco:0.5", StudyError, "not drawn"),
        ("mujoco|moreau:0.5", StudyError, "not drawn"),
        ("moreau|moreau:0.5", StudyError, "twice"),
        ("maximal-dissipation:0.5", StudyError, "takes no restitution"),
        ("scene:0.5", StudyError, "takes no restitution"),
        ("fremond:0.5", RestitutionError, "matrix"),
        ("nosuch.json", RestitutionError, "nosuch.json"),
    ],
)
def test_a_text_that_states_no_law_is_refused(text, error, message):
    with pytest.raises(error, match=message):
        read_law(text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tasks": JUGGLER}, "tasks is a tuple"),
        ({"tasks": (5,)}, "tasks are texts, such as 'Hopper-v5', got 5"),
        ({"policies": (None,)}, "policies are texts, such as 'ppo', got None"),
        ({"act": ()}, "act is empty"),
        ({"act": ("moreau:0.5", "moreau:0.50")}, "'moreau:0.50' twice"),
        ({"seeds": (2**63,)}, "a seed is a whole number from 0 to 2"),
        ({"seeds": (1, 1)}, "twice"),
        ({"seeds": (-1,)}, "a seed"),
        ({"seeds": (0.5,)}, "a seed"),
        ({"episodes": 0}, "episodes"),
        ({"steps": 100}, "steps=100 means nothing"),
        ({"policies": ("studies.acting:stay",), "train": ("moreau:0.5",)}, "train means nothing"),
        ({"schemes": ("sof",)}, "'soft'"),
    ],
)
def test_a_study_that_cannot_be_is_refused(changes, message):
    with pytest.raises(ImpactLawError, match=message):
        Study(**{"tasks": (JUGGLER,), "act": ("moreau:0.5",), "policies": ("scripted",), **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tasks": ("impactlaw/Jugler-v0",)}, "Jugler"),
        ({"tasks": ("nosuchmodule:Task-v0",)}, "nosuchmodule"),
        ({"tasks": ("impactlaw/Hopper-v5",)}, "many worlds"),
        ({"tasks": ("Hopper-v5",)}, "no scripted controller"),
        ({"act": ("mujoco",), "train": ("moreau:0.5",)}, "MuJoCo's own contacts"),
        ({"act": ("moreau:0.4..1",)}, "one coefficient"),
        ({"policies": ("scriptd",)}, "'scripted'"),
        ({"policies": ("nosuchmodule:act",)}, "nosuchmodule"),
        ({"policies": ("studies.acting:nosuch",)}, "nosuch"),
        ({"policies": ("studies.acting:np",)}, "no function"),
        ({"backend": "loki"}, "'loky'"),
        ({"backend": "multiprocessing"}, "as they are done"),
        ({"address": "tcp://127.0.0.1:1"}, "address means nothing"),
        ({"jobs": 0}, "jobs"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(changes, message, tmp_path):
    stated = {"tasks": (JUGGLER,), "act": ("moreau:0.5",), "policies": ("scripted",), "episodes": 1, "seeds": (0,)}
    options = {name: changes[name] for name in ("backend", "address", "jobs") if name in changes}
    stated |= {name: value for name, value in changes.items() if name not in options}
    with pytest.raises(ImpactLawError, match=message):
        run(Study(**stated), tmp_path / "out", **options)
    assert not list(tmp_path.glob("out/cells/*"))


@pytest.mark.parametrize("what", [None, "study.json"])
def test_what_is_no_study_is_refused(what, tmp_path):
    with pytest.raises(StudyError, match="a study is an"):
        run(what, tmp_path)


def test_an_episode_that_leaves_the_finite_numbers_ends():
    """MuJoCo's own environments continue, with rewards that are NaN."""
    conditions = Conditions("Hopper-v5", read_law("mujoco"), "soft")
    found = play(conditions, lambda: lambda observation: np.full(3, np.nan), [0, 1])
    assert (found["diverged"], found["steps"], found["score"]) == (2.0, 1.0, 0.0)
    found = play(conditions, lambda: lambda observation: np.zeros(3), [0])
    assert found["diverged"] == 0.0
    assert found["score"] > 0.0
