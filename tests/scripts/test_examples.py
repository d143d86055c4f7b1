"""Every example is short, runs without a display, and shows what its docstring promises."""

import re
import runpy
from pathlib import Path

import pytest
from wrapped import theirs

pytestmark = theirs
FOLDER = Path(__file__).parents[2] / "scripts" / "examples"
EXAMPLES = {path.stem: path for path in sorted(FOLDER.glob("*.py")) if path.stem != "__init__"}
TRAINS = "train_in_many_worlds"


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Run an example once; return its output, and the folder that it runs in."""
    folder, kept = tmp_path_factory.mktemp("examples"), {}

    def run(name, capsys, monkeypatch):
        if name not in kept:
            monkeypatch.chdir(folder)
            runpy.run_path(str(EXAMPLES[name]), run_name="__main__")
            kept[name] = capsys.readouterr().out
        return kept[name]

    run.folder = folder
    return run


@pytest.fixture
def numbers(shown, capsys, monkeypatch):
    """Return the numbers in each line of an example's output, for lines that contain numbers."""

    def read(name):
        lines = shown(name, capsys, monkeypatch).splitlines()
        found = [[float(x) for x in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", line)] for line in lines]
        return [row for row in found if row]

    return read


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_runs_and_prints(name, shown, capsys, monkeypatch):
    if name == TRAINS:
        pytest.importorskip("stable_baselines3", reason="impactlaw[train] is not installed")
    lines = EXAMPLES[name].read_text().splitlines()
    assert len(lines) <= 40
    assert "One sees" in EXAMPLES[name].read_text().split('"""')[1]
    assert len(shown(name, capsys, monkeypatch).splitlines()) >= 3


def test_there_are_eight_or_more():
    assert 8 <= len(EXAMPLES) <= 11


def test_only_the_reversal_law_hands_the_speed_on(numbers):
    dissipated, moreau, reversal, mujoco = (row[-6:] for row in numbers("newtons_cradle")[-4:])
    assert dissipated == pytest.approx([0.2] * 6)
    assert moreau == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4, 1.0])
    assert reversal == pytest.approx([0, 0, 0, 0, 1, 1])
    assert mujoco[-1] < 0.5


def test_hopper_bounces_higher_with_a_larger_coefficient(numbers):
    rises = [row[1] for row in numbers("law_on_hopper")[:4]]
    assert rises == sorted(rises)
    assert rises[-1] > 0.2


def test_the_ball_in_the_cup_loses_less_with_a_larger_coefficient(numbers):
    rows = numbers("law_on_dm_control")[1:]  # below the header
    assert [row[0] for row in rows] == [0.0, 0.5, 0.9]
    assert rows[0][3] > rows[2][3] > 0.0
    assert all(row[1] > 0 for row in rows)


def test_balls_rise_to_the_square_of_the_coefficient_of_their_pair(numbers):
    for coefficient, rises, _, square in numbers("pair_coefficients"):
        assert rises == pytest.approx(square, abs=1e-3) == pytest.approx(coefficient**2)


def test_the_audit_tells_possible_from_impossible(shown, capsys, monkeypatch):
    verdicts = shown("audit_your_simulator", capsys, monkeypatch).splitlines()
    assert ["impossible" in line for line in verdicts] == [False, False, True, True, False]
    assert "[-0.333  0.667  0.667]" in verdicts[-1]


def test_the_own_law_keeps_what_it_is_asked_to_if_contact_lets_it(numbers):
    kept = {row[0]: row[1] for row in numbers("own_law")}
    assert kept == pytest.approx({1.0: 1.0, 0.8: 0.8, 0.5: 0.5, 0.1: 0.3333})


def test_the_picture_of_s_is_drawn(shown, numbers):
    assert [row[:2] for row in numbers("draw_s")[1:3]] == [[1.0, 1.0], [0.0, 1.0]]  # e = 1 in the name of Moreau's
    assert (shown.folder / "out" / "possible_outcomes.png").stat().st_size > 10_000


def test_the_recording_has_the_break_of_the_rack(numbers):
    first = numbers("read_recording")[0]
    assert first[1:3] == [0.296875, 31.0]


def test_located_events_are_exact_and_the_others_of_first_order(numbers):
    errors = [row[-2] for row in numbers("compare_schemes")[-6:]]
    assert max(map(abs, errors[:2])) < 1e-12
    for coarse, fine in (errors[2:4], errors[4:]):
        assert 8 < abs(coarse / fine) < 60
