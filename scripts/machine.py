"""The machine that a table was measured on: processor, cores, and the versions of the packages that were timed."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("impactlaw", "mujoco", "numpy", "scipy", "daqp", "osqp")


def one_line() -> str:
    """Return the machine as one line for the foot of a table or a picture, with the cores available to this process."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    machine = f"{_processor()}, {cores} cores, {platform.system()}"
    threads = os.environ.get("OPENBLAS_NUM_THREADS")  # see `scripts/__init__.py`
    return f"{machine}; python {platform.python_version()}, {versions}; BLAS threads: {threads}"


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        for line in listed.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
