"""Time that ``import impactlaw`` adds to ``import mujoco``, in fresh processes, and the large packages it loads."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

HEAVY = (
    *("scipy.linalg", "scipy.sparse", "scipy.sparse.csgraph", "scipy.optimize", "scipy.spatial"),
    *("pandas", "matplotlib", "rerun", "gymnasium", "dm_control", "osqp", "daqp"),
)
_CODE = f"""
import json, sys, time
start = time.perf_counter()
import mujoco
middle = time.perf_counter()
before = set(sys.modules)
import impactlaw
end = time.perf_counter()
added = set(sys.modules) - before
print(json.dumps({{"mujoco_s": middle - start, "added_s": end - middle, "modules": len(added),
                  "heavy": [name for name in {HEAVY!r} if name in added]}}))
"""


@dataclass(frozen=True, kw_only=True)
class ImportTime:
    """How many processes to start."""

    processes: int = 15
    """Number of fresh processes."""


def run(study: ImportTime, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per process: mujoco_s, added_s, the number of modules that impactlaw loads, and the heavy ones."""
    rows = []
    for _ in range(study.processes):
        row = json.loads(subprocess.check_output([sys.executable, "-c", _CODE], text=True))
        rows.append(row | {"heavy": " ".join(row["heavy"])})
        progress()
    return pd.DataFrame(rows)
