"""The fifteen scenes: from the package, its dependencies and its development tools, and two built by the scripts."""

import mujoco

from impactlaw import models
from scripts.robots.scenes import Loaded, Scene, installed, load

QUICK = ("Hopper-v5", "Ant-v5", "Humanoid-v5", "dm/stacker", "box_drop")
_GYMNASIUM = ("Hopper", "Walker2d", "HalfCheetah", "Ant", "Humanoid")
_DOMAINS = ("quadruped walk", "dog stand", "humanoid_CMU stand", "manipulator bring_ball", "stacker stack_4")
_OWN = ("box_drop", "billiard_rack")
_BUILT = ("dominoes", "cards kicked")
_FRICTION, _CONDIM = 0.5, 3  # for our own models, which have no friction


def catalogue() -> list[Scene]:
    """Return the scenes whose packages are installed, and print which ones are left out."""
    known = [Scene(f"{name}-v5", "gymnasium", f"{name}-v5") for name in _GYMNASIUM]
    known += [Scene(f"dm/{key.split()[0]}", "dm_control", key) for key in _DOMAINS]
    known += [Scene("HandManipulateBlock", "gymnasium-robotics", "HandManipulateBlock")]
    known += [Scene(name, "file", str(models.scene_path(name))) for name in _OWN]
    known += [Scene(name, "built", name, raised=0.0) for name in _BUILT]
    return installed(known, {scene.source for scene in known})


def load_with_friction(scene: Scene) -> Loaded:
    """Load the scene, and give our own models friction."""
    loaded = load(scene)
    mujoco.set_mju_user_warning(lambda message: None)  # no warnings of motions that diverge, on screen or in a file
    if scene.name in _OWN:
        loaded.model.geom_condim[:] = _CONDIM
        loaded.model.geom_friction[:, 0] = _FRICTION
    return loaded
