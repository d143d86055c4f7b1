"""The study of random scenes prints what it finds as it finds it, also if it is interrupted."""

import sys

import pytest

from scripts.random_scenes import __main__ as random_scenes


@pytest.mark.parametrize("interrupted", [False, True])
def test_failures_are_printed_at_once(monkeypatch, capsys, interrupted):
    def rows(options):
        for seed in range(25):
            printed.append(capsys.readouterr().out)
            if interrupted and seed == 13:
                raise KeyboardInterrupt
            row = {"kind": "scene", "seed": seed, "outcome": "SceneError: of the fifth" if seed == 4 else "fine"}
            yield row | {"gain": 0.0, "gain_of_all": 0.0, "steps": 10, "longest": 0.01, "unlocated": 0}

    printed = []
    monkeypatch.setattr(random_scenes, "rows", rows)
    monkeypatch.setattr(random_scenes, "compile_steps", lambda: None)
    monkeypatch.setattr(sys, "argv", ["random_scenes", "--scenes", "25", "--piles", "1"])
    assert random_scenes.main() == 1
    assert "seed 4, outcome SceneError: of the fifth" in printed[5]
    assert "10 of 26: 1 failures so far" in printed[10]
    assert f"1 of {13 if interrupted else 25} ended with an exception" in capsys.readouterr().out


def test_the_default_run_takes_minutes():
    options = random_scenes.RandomScenes()
    assert options.scenes + options.piles < 100
