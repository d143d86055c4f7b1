"""Compute the transfer matrices of the README: policies that PPO trains under one law act under others.

Needs ``impactlaw[train]``, and up to an hour of one core for each task. Finished cells are kept; the same command
continues a study that was stopped. ``juggler.csv`` and ``hopper.csv`` beside this file hold the printed results.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from impactlaw.errors import ImpactLawError
from impactlaw.studies import Study, run
from impactlaw.studies.report import report
from scripts.options import Jobs, read

STUDIES = {
    "juggler": Study(
        tasks=("impactlaw/Juggler-v0",),
        train=("moreau:0.5", "moreau:0.8", "moreau:1", "moreau:0.4..1", "any-outcome"),
        act=("moreau:0.5", "moreau:0.8", "moreau:1", "any-outcome"),
        schemes=("time-stepping",),
        steps=500_000,
        episodes=20,
    ),
    "hopper": Study(
        tasks=("Hopper-v5",),
        schemes=("time-stepping",),
        train=("moreau:0", "moreau:0.5", "moreau:0.9", "moreau:0..0.9", "mujoco"),
        act=("moreau:0", "moreau:0.5", "moreau:0.9", "mujoco"),
        steps=500_000,
        episodes=20,
    ),
}


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Which study to run, and where to keep its results."""

    task: Literal["juggler", "hopper"] = "juggler"
    """Task of the study."""
    jobs: Jobs = -1
    """Number of cells at a time; -1 for one per processor."""
    out: Path = Path("out/transfer")
    """Folder for cells, policies, tables and pictures."""


def main() -> None:
    """Run the study of the command line, and print its report."""
    options = read(Transfer, __doc__)
    folder = options.out / options.task
    try:
        print(report(run(STUDIES[options.task], folder, jobs=options.jobs), folder))
    except ImpactLawError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
