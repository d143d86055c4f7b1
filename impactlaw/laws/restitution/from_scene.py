"""The law that a scene itself carries."""

from __future__ import annotations

from typing import Any

import mujoco

from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws.base import coefficient
from impactlaw.laws.newton import Newton
from impactlaw.scene.contacts import geom_names
from impactlaw.scene.joint_limits import Limits

RESTITUTION = "restitution"
"""Name of restitution in the ``<custom>`` section: ``<numeric name="restitution" data="0.5"/>`` is the default of the
scene, ``<numeric name="restitution/geomA/geomB" data="0.9"/>`` that of a pair of geoms, in either order, and
``<numeric name="restitution/joint" data="0.2"/>`` that of the limits of a joint or tendon."""


def scene_law(model: mujoco.MjModel) -> Newton:
    """Return the law that the scene itself carries: Newton, keyed by geom pairs, joints and tendons.

    Raises:
        RestitutionError: the scene names no restitution; or a ``<numeric>`` of it is not one number in [0, 1], or has
            been renamed by ``<attach>``.
        UnknownNameError: a coefficient names a geom, joint or tendon that the scene does not have.
    """
    table, default = _coefficients(model)
    if default is None and not table:
        raise RestitutionError(
            'the scene carries no restitution; add <custom><numeric name="restitution" data="0.5"/></custom> '
            "or pass a law"
        )
    return Newton(table, default=default)


def carries_restitution(model: mujoco.MjModel) -> bool:
    """Return whether a scene carries any restitution."""
    return any(model.numeric(i).name.split("/")[0] == RESTITUTION for i in range(model.nnumeric))


class SceneNumbers:
    """Tells when the numbers have changed that a scene carries, of which `scene_law` makes a law."""

    def __init__(self, model: mujoco.MjModel):
        self._model, self._read = model, model.numeric_data.tobytes
        self._seen = self._read()

    def changed(self) -> bool:
        """Return whether numbers have changed since this object was made."""
        return self._read() != self._seen

    def __getstate__(self) -> tuple[mujoco.MjModel, bytes]:
        """Return everything but the array of the model that is read."""
        return self._model, self._seen

    def __setstate__(self, state: tuple[mujoco.MjModel, bytes]) -> None:
        """Read the array of the copied model."""
        self._model, self._seen = state
        self._read = self._model.numeric_data.tobytes


def scene_restitution(model: mujoco.MjModel) -> float | None:
    """Return the default coefficient of a scene, for contacts without their own; None if it has no default.

    It raises the same errors as `scene_law`, except where the scene names no restitution.
    """
    return _coefficients(model)[1]


def _coefficients(model: mujoco.MjModel) -> tuple[dict[str | tuple[str, str], float], float | None]:
    names, limits = geom_names(model), Limits(model).names
    table: dict[str | tuple[str, str], float] = {}
    default = None
    for i in range(model.nnumeric):
        numeric = model.numeric(i)
        if numeric.name == RESTITUTION:
            default = _one_coefficient(numeric)
        elif numeric.name.startswith(f"{RESTITUTION}/"):
            table[_split_name(numeric.name, names, limits)] = _one_coefficient(numeric)
        elif numeric.name.split("/")[0].endswith(RESTITUTION):
            raise RestitutionError(
                f"<numeric name={numeric.name!r}> would be passed over: an <attach prefix=...> has renamed it. Put one "
                f"of the geoms' new names beside the <attach>, as {RESTITUTION}/a/b"
            )
    return table, default


def scene_number(model: mujoco.MjModel, name: str) -> float | None:
    """Return the first value of ``<numeric name=...>`` in the scene's ``<custom>``, or None."""
    index = mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_NUMERIC), name)
    return None if index < 0 else float(model.numeric(index).data[0])


def _one_coefficient(numeric: Any) -> float:
    """Return the coefficient that a ``<numeric>`` carries: one value in [0, 1]."""
    if len(numeric.data) != 1:
        raise RestitutionError(f"{numeric.name} of the scene must be one number in [0, 1], but has {len(numeric.data)}")
    return coefficient(numeric.data[0], f"{numeric.name} of the scene")


def _split_name(name: str, names: tuple[str, ...], limits: tuple[str, ...]) -> str | tuple[str, str]:
    """Return the geoms of ``restitution/a/b``, whose names may contain slashes, or the limit of ``restitution/a``."""
    parts = name.split("/")[1:]
    if "/".join(parts) in limits:
        return "/".join(parts)
    for cut in range(1, len(parts)):
        pair = "/".join(parts[:cut]), "/".join(parts[cut:])
        if pair[0] in names and pair[1] in names:
            return pair
    known = {f"{a}/{b}" for a in names for b in names if a < b}
    raise UnknownNameError("geom pair, or joint or tendon with a limit,", "/".join(parts), known | set(limits))
