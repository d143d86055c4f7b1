"""The scenes whose steps are timed: models, starts, laws and controls."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import gymnasium
import mujoco
import numpy as np

from impactlaw import Fremond, Law, Moreau
from impactlaw.laws.restitution.from_scene import scene_law
from impactlaw.models import load, scene_names
from impactlaw.models.builder import cradle

_STEPS = 200  # steps per episode of an environment
_HELD = 5  # steps of an environment for which a control is held


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One scene to step.

    Attributes:
        name: name of the scene.
        model: compiled model.
        law: law of rigid stepping.
        starts: positions and velocities that the episodes start from, in turn.
        episode: number of steps from one start.
        settle: number of steps before an episode is timed, for scenes at rest.
        friction: friction of rigid contacts, see `impactlaw.Stepper`.
        controls: controls of each step of an episode, (episode, nu); None without controls.
    """

    name: str
    model: mujoco.MjModel
    law: Law
    starts: tuple[tuple[np.ndarray, np.ndarray], ...]
    episode: int = 500
    settle: int = 0
    friction: Literal["coulomb", "convex", "ignore"] = "coulomb"
    controls: np.ndarray | None = None

    @property
    def integrator(self) -> str:
        """Name of the integrator."""
        return mujoco.mjtIntegrator(self.model.opt.integrator).name.removeprefix("mjINT_")

    def begin(
        self, data: mujoco.MjData, start: tuple[np.ndarray, np.ndarray], step: Callable[[mujoco.MjData], object]
    ) -> None:
        """Set the data to a start, and let the scene settle."""
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], data.qvel[:] = start
        for _ in range(self.settle):
            step(data)

    def drive(self, data: mujoco.MjData, number: int) -> None:
        """Set the controls of one step of an episode."""
        if self.controls is not None:
            data.ctrl[:] = self.controls[number]


def builders(sizes: tuple[int, ...], environments: tuple[str, ...], *, full: bool) -> dict[str, Callable[[], Scene]]:
    """Return functions that build the scenes, by name.

    Args:
        sizes: numbers of balls of the cradles.
        environments: ids of gymnasium's environments.
        full: whether to include every scene of models/.
    """
    found: dict[str, Callable[[], Scene]] = {f"cradle {n}": partial(_cradle, n) for n in sizes}
    found["box at rest"] = partial(_own, "box_drop", name="box at rest", resting=True)
    found["64 coplanar"] = _coplanar
    found |= {name: partial(_own, name) for name in (scene_names() if full else ("box_drop", "billiard_rack"))}
    if full:
        found["ball stack at rest"] = partial(_own, "ball_stack", name="ball stack at rest", resting=True)
    return found | {name: partial(_environment, name) for name in environments}


def _own(scene: str, *, name: str = "", resting: bool = False) -> Scene:
    model, data = load(scene)
    start = data.qpos.copy(), data.qvel.copy()
    settle = round(2.0 / model.opt.timestep) if resting else 0
    law = Fremond.reversal() if scene == "newtons_cradle" else scene_law(model)
    return Scene(name=name or scene, model=model, law=law, starts=(start,), settle=settle)


def _cradle(n: int) -> Scene:
    model = cradle(n).compile()
    key = model.key("start")
    law = Fremond.reversal() if n <= 10 else Moreau(1.0)
    return Scene(name=f"cradle {n}", model=model, law=law, starts=((key.qpos.copy(), key.qvel.copy()),))


def _coplanar() -> Scene:
    """Return a plate on 64 small spheres that all touch a plane."""
    radius, edge = 0.0625, 0.25
    feet = "".join(
        f'<geom name="foot{i}{k}" type="sphere" size="{radius}" mass=".01" pos="{edge * i} {edge * k} 0" condim="1"/>'
        for i in range(8)
        for k in range(8)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco model="coplanar"><option timestep=".005" integrator="RK4"/>
        <worldbody><geom name="floor" type="plane" size="0 0 1" condim="1"/><body name="plate" pos="0 0 {radius}">
        <freejoint/>{feet}<geom name="plate" type="box" size="1 1 .03125" pos=".875 .875 .03125" mass="1" contype="0"
        conaffinity="0"/></body></worldbody></mujoco>""")
    start = model.qpos0.copy(), np.zeros(model.nv)
    return Scene(name="64 coplanar", model=model, law=Moreau(0.5), starts=(start,))


def _environment(name: str, episodes: int = 5) -> Scene:
    env = gymnasium.make(name).unwrapped
    model, data = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    starts = []
    for seed in range(episodes):
        env.reset(seed=seed)
        starts.append((_within_limits(model, data.qpos), data.qvel.copy()))
    low, high = model.actuator_ctrlrange.T
    held = np.repeat(np.random.default_rng(0).uniform(low, high, (_STEPS // _HELD, model.nu)), _HELD, axis=0)
    options = {"name": name, "model": model, "law": Moreau(0.5), "starts": tuple(starts), "controls": held}
    return Scene(**options, episode=_STEPS, friction="ignore")


def _within_limits(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Return positions with limited hinges and slides clipped to their ranges, which the noise of a reset exceeds."""
    inside = qpos.copy()
    joints = np.flatnonzero((model.jnt_limited > 0) & (model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)))
    where = model.jnt_qposadr[joints]
    inside[where] = np.clip(qpos[where], *model.jnt_range[joints].T)
    return inside
