"""The machine that tables were measured on: processor, cores, versions of packages; files of tables that tell it."""

import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import pandas as pd

PACKAGES = ("impactlaw", "mujoco", "numpy", "scipy", "daqp", "osqp")


def one_line() -> str:
    """Return the machine as one line for the foot of a table or a picture, with the cores available to this process."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    machine = f"{_processor()}, {cores} cores, {platform.system()}"
    threads = os.environ.get("OPENBLAS_NUM_THREADS")  # see `scripts/__init__.py`
    return f"{machine}; python {platform.python_version()}, {versions}; BLAS threads: {threads}"


def write(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Write each table as CSV into a folder that exists, and the machine beside them."""
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "machine.txt").write_text(one_line() + "\n")


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        for line in listed.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
