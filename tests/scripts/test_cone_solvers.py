"""The study of cone solvers on a tiny scene: captured problems, a natural map by hand, and agreement of solvers."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import sparse

from impactlaw import Moreau
from impactlaw.solvers.cones import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.solve import solve
from impactlaw.stepping.plan import make_plan
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, raw
from impactlaw.stepping.time_stepping.make import make_time_stepping
from scripts.cone_solvers import capture, clarabel_cones, measure, report, solvers
from scripts.cone_solvers.__main__ import Study, captured, run
from scripts.cone_solvers.catalogue import QUICK, catalogue, load_with_friction
from scripts.cone_solvers.problem import Problem, scaled
from scripts.robots.scenes import of_files

OPTIONS = {"friction": "coulomb", "on_inadmissible": "project", "rest_speed": None}
SCENE = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 1" friction=".6 .01 .001"/>
<body pos="0 0 .0505"><freejoint/><geom type="box" size=".1 .1 .05" condim="4"/></body>
<body pos=".5 0 .0505"><freejoint/><geom type="box" size=".1 .1 .05" condim="3"/></body>
<body pos="1 0 .21"><joint name="a" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/>
  <body pos="0 .1 0"><joint name="b" axis="1 0 0" frictionloss=".1"/><geom size=".05" pos="0 .2 0" mass="1"/>
    <body pos="0 .4 0"><joint name="c" axis="1 0 0"/><geom size=".05" condim="6" mass="1"/></body></body></body>
</worldbody><equality><joint joint1="b" joint2="c" polycoef="0 -1 0 0 0"/></equality></mujoco>"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "tiny.xml"
    path.write_text(SCENE)
    return replace(of_files((path,))[0], raised=0.0)


@pytest.fixture(scope="module")
def problems(scene):
    return captured(Study(problems=12), [scene])


@pytest.fixture(scope="module")
def table(problems):
    who = solvers.solvers()
    measure.warm_up(who, problems)
    return run(Study(), problems, who)


def contact(b, exact=True):
    """Return one contact of unit rows with coefficients of friction of 1."""
    rows, one = sparse.csr_array(np.eye(3)), np.ones(1, np.int32)
    kind, tree = np.array([CONE], np.int32), np.zeros(3, np.int32)
    nothing = np.zeros(3)
    return Problem("", rows, tree, 3 * one, kind, np.zeros(1), nothing, np.array(b), nothing, exact, 24)


def solved(problem, guess=None):
    return solvers.compiled(problem, problem.guess if guess is None else guess)()[0]


@pytest.mark.parametrize(
    ("b", "exact", "x"),
    [
        ([-1.0, -0.5, 0.0], True, [1.0, 0.5, 0.0]),  # sticks
        ([-1.0, -2.0, 0.0], True, [1.0, 1.0, 0.0]),  # slides
        ([-1.0, -2.0, 0.0], False, [1.5, 1.5, 0.0]),  # slides and separates
        ([1.0, -2.0, 0.0], True, [0.0, 0.0, 0.0]),  # is open
    ],
)
def test_natural_map_by_hand(b, exact, x):
    problem = contact(b, exact)
    assert problem.natural_map(np.array(x)) < 1e-15
    assert problem.natural_map(x + np.array([0.1, 0.0, 0.0])) > 0.01
    assert problem.natural_map(x + np.array([0.0, 0.0, np.nan])) == np.inf
    assert problem.slides(np.array(x)) == (b == [-1.0, -2.0, 0.0])
    np.testing.assert_allclose(solved(problem), x, atol=1e-9)


def test_problems_are_those_of_the_scheme(scene):
    """Our copy of a step's problem has the solution that the step has found, if it has solved no other one."""
    loaded, seen, compared = load_with_friction(scene), [], 0
    model, data = loaded.model, mujoco.MjData(loaded.model)
    stepping = make_time_stepping(model, Moreau(0.5), make_plan(model, scheme="time-stepping"), **OPTIONS)
    stepping.watch(lambda posed: seen.append(capture.problem_of("", posed, model.dof_treeid, exact=True)))
    for _ in range(60):
        seen.clear()
        stepping.step(data)
        if len(seen) == 1:
            groups, n = stepping.numbers.view(np.int64)[MEMORY.groups : MEMORY.rows + 1]
            impulse = np.frombuffer(raw(stepping.numbers)[8 * (groups + n) :][: 8 * n])
            np.testing.assert_array_equal(solved(seen[0]), impulse)
            compared += seen[0].guess.any()
    assert compared > 10


def test_problems(problems):
    assert len(problems) == 12
    kinds, sizes = (np.unique(np.concatenate([getattr(p, name) for p in problems])) for name in ("kind", "size"))
    assert set(kinds) == {BILATERAL, BOX, CONE}
    assert {1, 3, 4} <= set(sizes)
    for problem in problems:
        x = solved(problem)
        lengths = np.sqrt(np.asarray(problem.rows.multiply(problem.rows).sum(axis=1)))
        assert np.maximum.reduceat(lengths, problem.first) == pytest.approx(1.0)
        *fields, exact = problem.fields
        theirs = solve(*fields[:4], problem.rows.shape[1], *fields[4:], x, exact, np.inf, 0, np.inf)[2]  # takes no step
        assert problem.natural_map(x) <= theirs + 1e-14


def test_scaling_keeps_the_problem(problems):
    """Longer rows and groups that cannot move do not change the solution."""
    one = problems[0]
    longer = np.repeat(np.linspace(0.1, 10.0, len(one.size)), one.size)
    nothing = np.zeros(3)
    again = scaled(
        replace(
            one,
            rows=sparse.vstack([sparse.diags_array(longer) @ one.rows, np.zeros((3, one.rows.shape[1]))], format="csr"),
            size=np.append(one.size, 3).astype(np.int32),
            kind=np.append(one.kind, CONE).astype(np.int32),
            bound=np.append(one.bound / longer[one.first], 0.0),
            compliance=np.concatenate([one.compliance * longer**2, nothing]),
            offset=np.concatenate([one.offset * longer, nothing - 1.0]),
            guess=np.concatenate([one.guess / longer, nothing]),
        )
    )
    for name in ("size", "kind", "bound", "compliance", "offset", "guess"):
        np.testing.assert_allclose(getattr(again, name), getattr(one, name), rtol=1e-12)
    np.testing.assert_allclose(again.delassus(), one.delassus(), atol=1e-12)
    assert again.scale == pytest.approx(one.scale)


def test_tables(table, problems, tmp_path):
    ours = table[table["solver"] == solvers.COMPILED]
    assert (ours["missed"] <= report.SHARP).all()
    swept = table[table["solver"] == "Gauss-Seidel"]
    assert (swept["missed"] <= report.SOLVED).mean() > 0.8
    assert len(ours) == len(swept) == 2 * len(problems)
    by_solver = report.by_solver(table)
    assert (by_solver["n"] <= len(problems)).all()
    assert by_solver["<= 1e-8 %"].between(0, 100).all()
    by_scene = report.by_scene(table)
    assert list(by_scene["n"]) == [len(problems)]
    assert list(by_scene["unsolved"]) == [0]
    assert "Gauss-Seidel" in report.show(table)
    report.write(table, tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == {"problems", "by_solver", "by_scene", "machine"}


def test_what_is_not_installed_is_said(monkeypatch, capsys):
    monkeypatch.setattr(solvers, "find_spec", lambda name: None if name == "clarabel" else name)
    assert [solver.name for solver in solvers.solvers()] == [solvers.COMPILED, "Gauss-Seidel"]
    assert "clarabel is not installed" in capsys.readouterr().out


def test_fifteen_scenes():
    names = [scene.name for scene in catalogue()]
    assert len(names) == len(set(names)) >= 14
    assert set(QUICK) <= set(names)


# --- beside Clarabel -------------------------------------------------------------------------------------------------


def random_problem(seed):
    """Return a solvable convex problem: contacts, a box, a soft bilateral row, more rows than degrees of freedom."""
    rng = np.random.default_rng(seed)
    size = np.array([3, 4, 1, 3, 6, 1, 1], np.int32)
    kind = np.array([CONE] * 5 + [BOX, BILATERAL], np.int32)
    n, nv = int(size.sum()), 12
    rows = sparse.csr_array(rng.normal(size=(n, nv)))
    compliance = np.append(np.zeros(n - 1), 0.1)
    bound = np.where(kind == BOX, 0.2, 0.0)
    offset = rows @ rng.normal(size=nv)
    return scaled(
        Problem("", rows, np.zeros(nv, np.int32), size, kind, bound, compliance, offset, np.zeros(n), False, 24)
    )


@pytest.mark.parametrize("seed", range(20))
def test_clarabel_finds_the_same_jump(seed):
    """The velocity of the convex relaxation is unique, and an interior point method finds it, too."""
    pytest.importorskip("clarabel", reason="clarabel, a reference to compare with, is not installed")
    problem = random_problem(seed)
    x, (other, _) = solved(problem), clarabel_cones.fixed_point(problem, problem.guess)
    assert problem.natural_map(x) <= report.SHARP
    assert problem.natural_map(other) < 1e-3
    np.testing.assert_allclose(problem.rows.T @ x, problem.rows.T @ other, atol=1e-4 * problem.scale)


@pytest.mark.parametrize("b", [[-1.0, -0.5, 0.0], [-1.0, -2.0, 0.0], [-1.0, -0.3, 3.0]])
def test_clarabel_finds_exact_friction(b):
    pytest.importorskip("clarabel", reason="clarabel, a reference to compare with, is not installed")
    problem = contact(b)
    x, taken = clarabel_cones.fixed_point(problem, problem.guess)
    assert problem.natural_map(x) < 1e-6
    assert taken > 1
    np.testing.assert_allclose(x, solved(problem), atol=1e-6)
