"""The kept tables are those of the stated studies, and say what the README says of them."""

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


def test_the_specialist_for_half_is_the_best_there_and_loses_elsewhere():
    table = kept("juggler")
    own = table.xs("moreau:0.5", level="acted_under").drop("moreau:0.5")
    assert (own.regret > own.regret_half).all()
    lost = table.loc["moreau:0.5"].loc[["moreau:0.8", "moreau:1"]]
    assert (lost.regret > lost.regret_half).all()
