"""What a table was measured on: the processor, its cores, and the versions of everything that was timed."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("impactlaw", "mujoco", "numpy", "scipy", "daqp", "osqp")


def describe() -> dict[str, str]:
    """Return the processor, the cores this process may use, the operating system, Python and the packages."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    machine = {"processor": _processor(), "cores": str(cores), "system": platform.system()}
    return machine | {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def one_line() -> str:
    """Return `describe` as one line for the foot of a table or a picture."""
    machine = describe()
    versions = ", ".join(f"{name} {value}" for name, value in machine.items() if name in ("python", *PACKAGES))
    return f"{machine['processor']}, {machine['cores']} cores, {machine['system']}; {versions}"


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        for line in listed.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
