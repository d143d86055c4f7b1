"""The benchmark: its quick form runs, its tables are complete, and the timed results are right. No test of speed."""

from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from wrapped import theirs

from impactlaw import Moreau, read_contacts
from scripts import machine
from scripts.benchmark import __main__ as benchmark
from scripts.benchmark import chains, goals, laws, omissions, scenes, steps
from scripts.benchmark.timing import in_turns

pytestmark = theirs


QUICK = benchmark.QUICK


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        patch.chdir(tmp_path_factory.mktemp("benchmark"))  # MuJoCo may write its warnings to a file there
        return benchmark.run(benchmark.Benchmark().parts, quick=True)


def positive(table, *columns):
    for column in columns:
        values = table[column].to_numpy(dtype=float)
        assert np.isfinite(values).all(), column
        assert (values > 0).all(), column


def test_every_law_has_a_row_and_is_certified(tables):
    table, sizes = tables["laws"], QUICK["laws"]["sizes"]
    expected = [(k, h, law) for k in ("independent", "plate") for h in sizes for law in laws.laws(k, h)]
    assert list(zip(table["kind"], table["h"], table["law"], strict=True)) == expected
    assert set(sizes) == set(table["h"])
    assert (table["residual"] < 1e-9).all()
    positive(table, "nnls_us", "law_us", "audited_us", "law_ratio", "audited_ratio")


@pytest.mark.parametrize("kind", ["independent", "plate"])
def test_problems_close_and_bare_nnls_solves_them(kind):
    from scipy.optimize import nnls

    for h in (1, 4, 16):
        for collision in laws.collisions(kind, h, 3, seed=1):
            assert collision.jacobian.shape[0] == h
            assert (collision.pre_contact_velocity < 0).all()
            for law in laws.laws(kind, h).values():
                problem = laws.problem(law, collision)
                Y, c = problem.gradients, problem.bound
                np.testing.assert_allclose(Y @ problem.preimage, c, atol=1e-12 * np.abs(c).max())
                impulse, _ = nnls(Y.T, problem.preimage)
                v = collision.whitened_velocity + Y.T @ impulse
                known = laws.fresh(collision)
                post = known.metric.whiten(law.resolve(known).post_velocity)
                np.testing.assert_allclose(post, v, atol=1e-10 * np.linalg.norm(v))


def test_a_fresh_collision_has_derived_nothing():
    (collision,) = laws.collisions("independent", 4, 1, seed=0)
    known = laws.fresh(collision)
    assert known.whitened_jacobian is collision.whitened_jacobian
    assert not {"gradient_norms", "pre_contact_velocity", "pre_speed"} & set(known.__dict__)


def test_steps_of_every_scene(tables):
    table = tables["steps"]
    chosen = QUICK["steps"]
    assert set(table["scene"]) == set(scenes.builders(chosen["cradles"], chosen["environments"], full=chosen["full"]))
    assert (table["outcome"] == steps.FINE).all()
    assert (table["residual"] < 1e-9).all()
    assert (table["penetration"] <= 1.1e-9).all()
    positive(table, "steps", "mj_steps", "median_us", "mean_us", "mj_median_us", "mj_mean_us", "ratio", "mean_ratio")
    for _, rows in table.groupby("scene"):
        whole = rows[rows["phase"] == steps.ALL]
        assert len(whole) == 1
        counted = rows.loc[rows["phase"].isin(steps.PHASES), "steps"].sum()
        assert whole["steps"].item() == counted >= steps.FEWEST


def test_phases_are_what_the_scenes_do(tables):
    rigid = tables["steps"].groupby("scene")["phase"].agg(set)
    assert rigid["box at rest"] == {"contact", "all"}
    assert rigid["64 coplanar"] == {"contact", "all"}
    assert {"contact", "collision"} <= rigid["cradle 5"]
    assert "flight" in rigid["box_drop"]


def test_the_plate_rests_on_all_of_its_feet():
    scene = scenes.builders((), (), full=False)["64 coplanar"]()
    import mujoco

    data = mujoco.MjData(scene.model)
    scene.begin(data, scene.starts[0], lambda data: None)
    assert len(read_contacts(scene.model, data)) == 64


def test_scenes_have_names_of_their_own():
    for name, build in scenes.builders((5,), (), full=True).items():
        assert build().name == name


def test_import_is_timed_beside_mujocos(tables):
    assert len(tables["imports"]) == QUICK["imports"]["processes"]
    positive(tables["imports"], "mujoco_s", "added_s", "modules")


def test_goals_tell_met_from_not_met(tables):
    lines = tables["goals"]
    assert lines["measured"].str.contains(r"\d").all()
    assert len(lines) >= 8
    steps = tables["steps"].copy()
    for factor, met in ((0.0, True), (1e6, False)):
        steps["ratio"] = factor * tables["steps"]["ratio"] + (0.5 if met else 0.0)
        assert all(line.met is met for line in goals.goals({"steps": steps}))
    imports = pd.DataFrame({"added_s": [0.1, 0.31, 0.32], "mujoco_s": [0.5] * 3})
    (line,) = goals.goals({"imports": imports})
    assert not line.met
    assert "0.310" in line.measured


def test_what_is_written_is_what_was_measured(tables, tmp_path):
    machine.write(tables, tmp_path)
    for name, table in tables.items():
        assert len(pd.read_csv(tmp_path / f"{name}.csv")) == len(table)
    shown = benchmark.show(tables)
    assert "mujoco" in (tmp_path / "machine.txt").read_text()
    assert all(goal in shown for goal in tables["goals"]["goal"])


def test_calls_in_turns_are_all_made_and_counted():
    made = {"a": 0, "b": 0}

    def count(name):
        made[name] += 1

    timed = in_turns(
        {name: lambda name=name: [lambda: count(name)] * 3 for name in made},
        seconds=0.0,
        fewest=4,
    )
    assert made == {"a": 15, "b": 15}  # one round is not counted
    assert {name: len(values) for name, values in timed.seconds.items()} == {"a": 4, "b": 4}


def test_chains_are_solved_and_certified(tables):
    table = tables["chains"]
    law = table[table["solver"] == "law"]
    expected = [(start, h) for start in chains.STARTS for h in QUICK["chains"]["sizes"]]
    assert list(zip(law["chain"], law["h"], strict=True)) == expected
    assert (law["outcome"] == "solved").all()
    assert (law["residual"] < goals.CHAIN_RESIDUAL).all()
    solved = table[table["outcome"] == "solved"]
    positive(solved, "milliseconds", "ratio")
    assert (solved["residual"] < 1e-6).all()  # answers of OSQP and Clarabel are correct, too
    osqp = table[table["solver"].str.startswith("osqp") & (table["h"] == 100)]
    assert (osqp["outcome"] == "solved").all()
    if find_spec("clarabel") is None:
        assert set(table.loc[table["solver"].str.startswith("clarabel"), "outcome"]) == {"not installed"}


@pytest.mark.parametrize("start", ["launched", "random"])
def test_residual_of_a_chain_is_zero_for_its_answer_only(start):
    problem = chains.chain(20, start, seed=3)
    impulse = Moreau(0.5).resolve(problem.collision).impulse
    assert problem.residual(impulse) < 1e-14
    assert problem.residual(impulse + 1e-6) > 1e-8
    separating = np.count_nonzero(problem.collision.pre_contact_velocity > 0)
    assert bool(separating) is (start == "random")


def test_a_part_that_is_not_needed_changes_no_step(tables):
    table = tables["omissions"]
    assert set(table["scene"]) == set(QUICK["omissions"]["scenes"])
    assert "detection" in set(table.loc[table["scene"] == "pendulum", "left_out"])
    positive(table, "planned_us", "forced_us", "ratio")
    assert (table["difference"] == 0).all()


def test_parts_that_came_later_are_shown_where_a_scene_has_none(tables):
    table = tables["omissions"]
    for scene in ("pendulum", "cradle 5"):
        shown = table.loc[table["scene"] == scene, "left_out"]
        assert set(omissions.LATER) <= set(shown)
    for part in omissions.LATER:
        slower = table[table["left_out"] == part].assign(ratio=0.5)
        same = slower.assign(ratio=1.0)
        other = same.assign(difference=1e-9)
        lines = [goals.goals({"omissions": case})[0] for case in (slower, same, other)]
        assert [line.met for line in lines] == [False, True, False]
        assert part in lines[0].goal


def test_worlds_are_counted_and_compared(tables):
    table = tables["worlds"]
    chosen = QUICK["worlds"]
    expected = list(product(chosen["tasks"], chosen["counts"], chosen["threads"]))
    assert list(zip(table["task"], table["worlds"], table["threads"], strict=True)) == expected
    positive(table, "steps_per_s", "to_shipped", "to_euler", "soft_to_shipped")
    positive(tables["vector"], "steps_per_s")
    assert len(tables["vector"]) == 2
    assert "compiling" not in tables


def test_goals_of_worlds():
    columns = ("task", "worlds", "threads", "steps_per_s", "to_shipped", "to_euler", "soft_to_shipped")
    rows = ("A", 1024, 1, 10.0, 1.0, 1.0, 1.0), ("A", 1024, 2, 17.0, 1.2, 0.3, 0.95), ("A", 16, 2, 1.0, 0.1, 0.1, 0.1)
    worlds = pd.DataFrame([dict(zip(columns, row, strict=True)) for row in rows])
    vector = pd.DataFrame({"environments": ["a", "b"], "steps_per_s": [10.0, 3.0]})
    compiling = pd.DataFrame({"process": ["compiles", "loads", "loads"], "processor_s": [50.0, 1.0, 2.5]})
    lines = goals.goals({"worlds": worlds, "vector": vector, "compiling": compiling})
    assert [line.met for line in lines] == [True, False, True, False, False, True, True]
    assert [line.measured for line in lines] == ["1.20", "0.30", "0.95", "1.70", "3.3", "50.0 s", "1.8 s"]


def test_steps_of_many_worlds_do_not_meet_the_goal_of_one_environment():
    rates = ("event-driven", 10.0), ("time-stepping", 20.0), ("256 worlds", 99_000.0)
    rows = [{"task": "Juggler", "scheme": scheme, "steps_per_second": rate} for scheme, rate in rates]
    (line,) = goals.goals({"tasks": pd.DataFrame(rows)})
    assert not line.met
    rows[1]["steps_per_second"] = 5000.0
    (line,) = goals.goals({"tasks": pd.DataFrame(rows)})
    assert line.met
