"""The study behind the page of identification, on a few drops and collisions: tables, picture, and their places."""

import sys
from pathlib import Path

import numpy as np
import pytest
import tyro

sys.path.insert(0, str(Path(__file__).parents[2]))

from impactlaw import Compliant
from scripts.identification import __main__ as study
from scripts.identification.chains import chains_table, paths_table, study_chain
from scripts.identification.drops import drops_table, measure
from scripts.identification.energy import CASES, energy_table
from scripts.identification.pictures import draw_paths


def test_tables():
    table = drops_table(measure(every=40, folds=2, families=("newton", "coulomb")))
    assert "of the tangential rows**" in table
    assert "| coulomb | 0.1" in table
    chains = chains_table([study_chain(np.ones(3), Compliant(1.0), n=20)])
    assert "| 3 equal | (-0.0710, 0.0764, 0.9945) |" in chains
    assert "| exponent | 1.5 | (0.1474, 0.9181) |" in paths_table()
    energy = energy_table(20).splitlines()[2:]
    assert len(energy) == len(CASES)
    assert all(float(line.split("|")[-2]) <= 1e-10 for line in energy)


def test_the_picture_is_small(tmp_path):
    draw_paths(tmp_path / "chains.png")
    assert 5_000 < (tmp_path / "chains.png").stat().st_size < 40_000


def test_tables_go_between_their_marks(tmp_path, monkeypatch):
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- energy -->\nold\n<!-- end of energy -->\nafter\n")
    monkeypatch.setattr(study, "PAGE", page)
    tyro.cli(study.main, args=["energy", "--count", "3"])
    text = page.read_text()
    assert text.startswith("before\n<!-- energy -->\n\n| law |")
    assert text.endswith("\n\n<!-- end of energy -->\nafter\n")
    assert "old" not in text
    with pytest.raises(SystemExit, match="has no mark"):
        study.put(text, "drops", "table")
