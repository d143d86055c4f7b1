"""The properties of a run that are recorded once."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from impactlaw.laws import Law, MaximalDissipation
from impactlaw.laws.restitution.coefficients import described
from impactlaw.recording.layout import FORMAT

_PACKAGES = {"impactlaw": "impactlaw", "mujoco": "mujoco", "numpy": "numpy", "rerun": "rerun-sdk"}
PROPERTY_NAMES = ("format", "scene", "law", "restitution", "timestep", "integrator", "seed", "versions")


def run_properties(
    model: mujoco.MjModel, *, law: Any, restitution: Any, scene: str | Path | None, seed: int | None
) -> dict[str, Any]:
    """Return the properties of a run, as values that JSON can represent."""
    if restitution is None and isinstance(law, Law):
        restitution = law_restitution(law)
    model_name = model.names[: model.names.index(b"\0")].decode()
    return {
        "format": FORMAT,
        "scene": str(scene) if scene is not None else model_name,
        "law": law_name(law),
        "restitution": _plain(restitution),
        "timestep": float(model.opt.timestep),
        "integrator": mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_"),
        "seed": _plain(seed),
        "versions": {name: importlib.metadata.version(package) for name, package in _PACKAGES.items()},
    }


def law_name(law: Any) -> str | None:
    """Return a law as one line of text: its repr, or its name if it is given by name."""
    return law if law is None or isinstance(law, str) else " ".join(repr(law).split())


def law_restitution(law: Law) -> Any:
    """Return the restitution of a law's normal part: one coefficient, several, or a matrix; None if it has none."""
    inner = law.normal_law
    if isinstance(inner, MaximalDissipation):
        return 0.0
    found = next((getattr(inner, name) for name in ("restitution", "matrix", "h") if hasattr(inner, name)), None)
    return getattr(inner, "default", None) if isinstance(found, dict) and not found else found


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key if isinstance(key, str) else ", ".join(map(str, key)): _plain(e) for key, e in value.items()}
    if value is None or isinstance(value, str):
        return value
    if callable(value):
        return str(described(value))
    if isinstance(value, tuple | list):
        return [_plain(e) for e in value]
    return np.asarray(value).tolist()
