"""The stored tables belong to the stated studies, and agree with the README."""

from pathlib import Path

import pandas as pd
import pytest

from scripts.transfer.__main__ import STUDIES

HERE = Path(__file__).parents[2] / "scripts" / "transfer"


def kept(task):
    return pd.read_csv(HERE / f"{task}.csv").set_index(["policy", "acted_under"])


@pytest.mark.parametrize("task", STUDIES)
def test_there_is_an_entry_for_each_pair_of_laws(task):
    table, study = kept(task), STUDIES[task]
    assert set(table.index) == {(one, other) for one in study.train for other in study.act}
    assert set(table.task) == set(study.tasks)
    assert (table.seeds == len(study.seeds)).all()
    best = table.groupby("acted_under").score.transform("max")
    assert table.regret.to_numpy() == pytest.approx((best - table.score).to_numpy())


SPECIALISTS = ["moreau:0.5", "moreau:0.8", "moreau:1"]


@pytest.mark.parametrize("law", SPECIALISTS)
def test_specialists_are_the_best_under_their_law_and_lose_elsewhere(law):
    table = kept("juggler")
    under = table.xs(law, level="acted_under")
    assert under.score.idxmax() == law
    others = under.loc[[name for name in SPECIALISTS if name != law]]
    assert (others.regret > others.regret_half).all()


def test_any_outcome_never_fails_as_specialists_do():
    score = kept("juggler").score
    assert score["any-outcome"].min() > 430.0 > 10.0 * score["moreau:0.5"].min()


def test_each_law_of_hopper_has_its_own_policy_as_the_best():
    score = kept("hopper").score
    for law in STUDIES["hopper"].act:
        assert score.xs(law, level="acted_under").idxmax() == law
