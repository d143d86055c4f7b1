"""The scenes: one MJCF file each, its closed-form answer in the comment on top.

Conventions, all in plain MJCF:

- a keyframe named ``start`` holds the positions and velocities a simulation starts from;
- ``<custom><numeric name="restitution" data="0.5"/></custom>`` is the scene's coefficient of restitution, and
  ``<numeric name="restitution/geomA/geomB" data="0.9"/>`` that of one pair of geoms, in either order;
- ``<numeric name="duration" data="2"/>`` is how long the scene is worth watching, s;
- ``<text name="description" data="..."/>`` says in one line what it is;
- a camera named ``main`` frames it; geoms that can collide have ``condim="1"`` (no friction).

A new scene is a new file; its name is the file's.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from impactlaw.errors import SceneError, UnknownNameError

if TYPE_CHECKING:
    import mujoco

START = "start"
"""Name of the keyframe a simulation starts from."""

_FOLDER = Path(__file__).parent


def _description(path: Path) -> str:
    text = ElementTree.parse(path).find("custom/text[@name='description']")
    return "" if text is None else text.get("data", "")


SCENES: dict[str, str] = {path.stem: _description(path) for path in sorted(_FOLDER.glob("*.xml"))}
"""Name and one-line description of every scene."""


def scene_names() -> tuple[str, ...]:
    """Return the names of all scenes, sorted."""
    return tuple(SCENES)


def scene_path(name: str) -> Path:
    """Return the MJCF file of a scene.

    Args:
        name: one of `scene_names`, with underscores or hyphens.

    Raises:
        UnknownNameError: no such scene; the message names the nearest ones.
    """
    known = name.replace("-", "_") if isinstance(name, str) else None
    if known not in SCENES:
        raise UnknownNameError("scene", name, SCENES)
    return _FOLDER / f"{known}.xml"


def load(name_or_path: str | Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Compile a scene and put its data at the keyframe ``start``, or where the model has none at its default.

    Only time, qpos, qvel and the other state are set; derived quantities are not computed.

    Args:
        name_or_path: the name of a scene, or a path to any MJCF file. A string without folder and ending that
            names neither a scene nor something that exists is taken for a misspelled scene.

    Raises:
        UnknownNameError: no scene of that name; the message names the nearest ones.
        SceneError: no such file, one that may not be read, a directory, not XML, or not a model that MuJoCo compiles.
    """
    import mujoco

    path = _resolve(name_or_path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        message = " ".join(str(error).split())
        raise SceneError(f"{path} is not a scene that MuJoCo compiles: {message}") from None
    data = mujoco.MjData(model)
    key = mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_KEY), START)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    return model, data


def _resolve(name_or_path: str | Path) -> Path:
    if not isinstance(name_or_path, str | os.PathLike):
        raise UnknownNameError("scene", name_or_path, SCENES)
    path = Path(name_or_path)
    if isinstance(name_or_path, str):
        is_name = not name_or_path or (len(path.parts) == 1 and not path.suffix and not path.exists())
        if is_name or name_or_path.replace("-", "_") in SCENES:
            return scene_path(name_or_path)
    if path.is_dir():
        raise SceneError(f"{path} is a directory, not an MJCF file")
    if not path.exists():
        raise SceneError(f"no such file: {path}")
    if not os.access(path, os.R_OK):
        raise SceneError(f"no permission to read {path}")
    return path
