"""Transfer matrices and regrets against numbers by hand."""

import math

import pandas as pd
import pytest

from impactlaw.errors import StudyError
from impactlaw.studies import transfer_matrices, transfer_matrix
from impactlaw.studies.pictures import draw

SCORES = {  # trained under, acted under: scores of seeds 0, 1, 2
    ("a", "x"): (10.0, 12.0, 14.0),
    ("a", "y"): (1.0, 2.0, 3.0),
    ("b", "x"): (4.0, 5.0, 9.0),
    ("b", "y"): (7.0, 7.0, 7.0),
}
T = 0.95 * math.sqrt(2.0 / (4.0 * 0.975 * 0.025))  # Student's t for 95 % and two degrees of freedom, closed form


def table(task: str = "T-v0", scheme: str = "soft", policy: str = "ppo") -> pd.DataFrame:
    return pd.DataFrame(
        {"task": task, "scheme": scheme, "policy": policy, "trained_under": train, "acted_under": act, "seed": seed,
         "score": score}
        for (train, act), scores in SCORES.items()
        for seed, score in enumerate(scores)
    )  # fmt: skip


def test_scores_and_regrets_are_those_of_hand():
    matrix = transfer_matrix(table())
    assert matrix.score.to_numpy().tolist() == [[12.0, 2.0], [6.0, 7.0]]
    assert matrix.regret.to_numpy().tolist() == [[0.0, 5.0], [6.0, 0.0]]
    half = T * 2.0 / math.sqrt(3.0)  # 10, 12, 14: standard deviation 2
    assert matrix.half.loc["a", "x"] == pytest.approx(half, rel=1e-12)
    assert matrix.half.loc["a", "y"] == pytest.approx(half / 2.0, rel=1e-12)
    assert matrix.half.loc["b", "y"] == 0.0
    assert matrix.regret_half.loc["a", "y"] == pytest.approx(half / 2.0, rel=1e-12)  # 6, 5, 4
    assert matrix.regret_half.loc["b", "x"] == pytest.approx(T * 1.0 / math.sqrt(3.0), rel=1e-12)  # 6, 7, 5
    assert math.isnan(matrix.regret_half.loc["a", "x"])
    assert (matrix.seeds, list(matrix.score.index), list(matrix.score.columns)) == (3, ["a", "b"], ["x", "y"])


def test_half_the_confidence_is_a_narrower_interval():
    wide, narrow = transfer_matrix(table()), transfer_matrix(table(), confidence=0.5)
    assert narrow.half.loc["a", "x"] == pytest.approx(wide.half.loc["a", "x"] * 0.816496580927726 / T, rel=1e-9)


def test_one_seed_has_no_interval():
    matrix = transfer_matrix(table().query("seed == 0"))
    assert matrix.half.isna().to_numpy().all()
    assert "±" not in str(matrix)
    assert "one seed" in str(matrix)


def test_the_best_of_a_column_is_bold():
    text = transfer_matrix(table()).to_markdown()
    assert "| a | **12.0 ± 5.0** | 2.0 ± 2.5 |" in text
    assert "| b | 6.0 ± 6.6 | **7.0 ± 0.0** |" in text
    assert "| a | 0.0 | 5.0 ± 2.5 |" in text


def test_several_policies_are_told_apart():
    both = pd.concat([table(), table(policy="scripted").assign(trained_under="")])
    matrix = transfer_matrix(both[~both.duplicated(["policy", "trained_under", "acted_under", "seed"])])
    assert list(matrix.score.index) == ["ppo, a", "ppo, b", "scripted"]


def test_each_task_and_scheme_has_a_matrix():
    both = pd.concat([table(), table(scheme="time-stepping"), table("U-v0")])
    found = [(matrix.task, matrix.scheme) for matrix in transfer_matrices(both)]
    assert found == [("T-v0", "soft"), ("T-v0", "time-stepping"), ("U-v0", "soft")]
    with pytest.raises(StudyError, match="several"):
        transfer_matrix(both)
    with pytest.raises(StudyError, match="V-v0"):
        transfer_matrix(both, task="V-v0")


def test_missing_cells_and_impossible_confidence_are_refused():
    with pytest.raises(StudyError, match="lacks cells"):
        transfer_matrix(table()[1:])
    with pytest.raises(StudyError, match="no column policy, score"):
        transfer_matrix(table().drop(columns=["policy", "score"]))
    with pytest.raises(StudyError, match="confidence"):
        transfer_matrix(table(), confidence=95)


def test_the_csv_has_a_row_per_entry():
    frame = transfer_matrix(table()).to_frame()
    assert frame[["policy", "acted_under", "score", "regret"]].to_numpy().tolist() == [
        ["a", "x", 12.0, 0.0],
        ["a", "y", 2.0, 5.0],
        ["b", "x", 6.0, 6.0],
        ["b", "y", 7.0, 0.0],
    ]


@pytest.mark.parametrize("rows", [1, 2])
def test_the_picture_holds_all_labels(rows, tmp_path):
    import matplotlib.image

    names = {"a": "a law with a name that is rather long:0.25..0.75", "b": "b"}
    few = table().query("trained_under == 'a'") if rows == 1 else table()
    long = few.replace({"trained_under": names, "acted_under": {"x": "another law with a long name:0.123456"}})
    draw(transfer_matrix(long), tmp_path / "picture.png")
    pixels = matplotlib.image.imread(tmp_path / "picture.png")[..., :3]
    edge = 4
    borders = pixels[:edge], pixels[-edge:], pixels[:, :edge], pixels[:, -edge:]
    assert all((border == 1.0).all() for border in borders)  # no label is cut off
    assert (pixels < 1.0).any()


@pytest.mark.parametrize("what", [None, "table.parquet", {"task": ["a"]}], ids=str)
def test_what_is_no_table_is_refused(what):
    for asked in (transfer_matrix, lambda table: next(transfer_matrices(table))):
        with pytest.raises(StudyError, match="not the table of a study"):
            asked(what)


def test_names_with_the_mark_between_cells_stay_one_cell():
    drawn = table().replace({"a": "moreau|reversal:0.5", "x": "moreau|reversal:0.5"})
    lines = transfer_matrix(drawn).to_markdown().splitlines()
    assert r"| moreau\|reversal:0.5 | **12.0 ± 5.0** | 2.0 ± 2.5 |" in lines
    assert r"| score of, under | moreau\|reversal:0.5 | y |" in lines


def test_cells_that_are_there_twice_are_refused():
    with pytest.raises(StudyError, match="more than one cell of a under x, seed 0"):
        transfer_matrix(pd.concat([table(), table()]))


def test_dollars_in_names_begin_no_formula(tmp_path):
    """Regression: a name that is not a formula of matplotlib raised an error when it was drawn."""
    odd = table(policy="mine$\\frac$:act").replace({"x": "out/$\\frac$/law.json", "a": "$\\frac$.json"})
    draw(transfer_matrix(odd), tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 0
