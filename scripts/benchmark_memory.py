"""Peak memory of a law and of stepping, each case in a process of its own, and how it grows."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

MEGA = 1e6


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Which cases."""

    contacts: tuple[int, ...] = (1, 16, 64, 256)
    """Contacts of a law's dense random problems."""
    cradles: tuple[int, ...] = (5, 100, 1000)
    """Balls of the cradles that are stepped."""
    steps: int = 20
    """Rigid steps of each."""


def cases(study: Memory) -> list[tuple[str, int]]:
    """Return the cases to come; ("nothing", 0) has imported everything and does nothing."""
    return [("nothing", 0), *(("law", h) for h in study.contacts), *(("cradle", n) for n in study.cradles)]


def run(study: Memory, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per case.

    Columns: python_peak_mb (tracemalloc: Python's and numpy's part, of the case alone), process_peak_mb (the resident
    process at its largest) and what that is above a process that does nothing, added_mb; seconds of the first run.
    """
    rows = []
    for case, size in cases(study):
        rows.append({"case": case, "size": size, **_in_a_process(case, size, study.steps)})
        progress()
    table = pd.DataFrame(rows)
    table["added_mb"] = table["process_peak_mb"] - table["process_peak_mb"].iloc[0]
    return table


def _in_a_process(case: str, size: int, steps: int) -> dict[str, float]:
    command = [sys.executable, __file__, case, str(size), str(steps)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])


def measure(case: str, size: int, steps: int) -> dict[str, float]:
    """Run one case in this process: once to see how large that becomes, once with Python's allocations traced."""
    prepare = {"nothing": _nothing, "law": _law, "cradle": _cradle}[case]
    work = prepare(size, steps)
    start = time.perf_counter()
    work()
    seconds = time.perf_counter() - start
    largest = _largest()
    work = prepare(size, steps)
    tracemalloc.start()
    work()
    _, peak = tracemalloc.get_traced_memory()
    return {"python_peak_mb": peak / MEGA, "process_peak_mb": largest / MEGA, "seconds": seconds}


def _largest() -> float:
    """Return the largest resident size of this process, bytes.

    Linux hands ``ru_maxrss`` on to a child process; the high-water mark in /proc is the child's own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        marks = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM:")]
        if marks:
            return 1024.0 * float(marks[0])
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest * (1.0 if sys.platform == "darwin" else 1024.0)


def _nothing(size: int, steps: int) -> Callable[[], object]:
    return lambda: None


def _law(h: int, steps: int) -> Callable[[], object]:
    from impactlaw import Collision, Moreau

    rng = np.random.default_rng(h)
    nv = (3 * h + 1) // 2
    J = rng.normal(size=(h, nv))
    velocity = -np.linalg.lstsq(J, rng.uniform(0.5, 1.5, h), rcond=None)[0]

    def work() -> None:
        Moreau(0.5).resolve(Collision(np.eye(nv), J, velocity))

    return work


def _cradle(n: int, steps: int) -> Callable[[], object]:
    import mujoco

    from impactlaw import Moreau, Stepper
    from impactlaw.models.builder import cradle

    model = cradle(n).compile()

    def work() -> None:
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        stepper = Stepper(model, Moreau(1.0))
        for _ in range(steps):
            stepper.step(data)

    return work


if __name__ == "__main__":
    import impactlaw  # noqa: F401  (part of every case, also of the one that does nothing)

    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
