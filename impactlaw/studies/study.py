"""The definition of a study: which policies, made for which laws, act under which laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from impactlaw.errors import StudyError, UnknownNameError
from impactlaw.studies.laws import StatedLaw, read_law

Scheme = Literal["soft", "time-stepping", "event-driven"]
PPO, SCRIPTED = "ppo", "scripted"
_STEPS = 100_000
_EXAMPLES = {"tasks": "Hopper-v5", "policies": PPO}


@dataclass(frozen=True, kw_only=True)
class Study:
    """Tasks, policies made for laws, and the laws under which they act; every combination is a cell.

    A law is given as text: "moreau:0.5", "maximal-dissipation", "law.json" for a law from a file, "moreau:0.4..1" or
    "moreau|reversal:0.8" for a law drawn for each episode, and "mujoco" for MuJoCo's own contacts, on tasks of other
    packages (`impactlaw.studies.laws.read_law`).

    Attributes:
        tasks: ids of gymnasium, such as "impactlaw/Juggler-v0" or "Hopper-v5"; "module:id" imports the module first.
        act: laws to act under.
        train: laws to make policies for; by default those of `act`.
        policies: "ppo", trained under each law of `train` from each seed; "scripted", the controllers of this package's
            own tasks, tuned to each law of `train` if they can be tuned; "module:name" for a function of the
            observation, or a class of such functions, with one instance per episode; "file.zip", a policy saved by
            stable-baselines3.
        schemes: ways to step, for training and acting: "soft", "time-stepping", "event-driven"; by default
            event-driven for tasks of this package and soft for others.
        seeds: each seed trains its own policy and plays its own episodes, which are the same under every law.
        episodes: number of episodes of a cell.
        steps: steps of a training, in whole rollouts of 16 384; by default 100 000.

    Raises:
        StudyError: a field is empty, has a value twice, is of a wrong type, or would have no effect.
        UnknownNameError: there is no such law or scheme.
        RestitutionError: a restitution does not fit its law.
    """

    tasks: tuple[str, ...]
    act: tuple[str, ...]
    train: tuple[str, ...] = ()
    policies: tuple[str, ...] = (PPO,)
    schemes: tuple[Scheme, ...] = ()
    seeds: tuple[int, ...] = (0, 1, 2)
    episodes: int = 20
    steps: int | None = None

    def __post_init__(self):
        for name in ("tasks", "act", "train", "policies", "schemes", "seeds"):
            self._check_several(name)
        for scheme in self.schemes:
            if scheme not in get_args(Scheme):
                raise UnknownNameError("scheme", scheme, get_args(Scheme))
        for seed in self.seeds:
            if not _is_count(seed, 0) or seed >= 2**63:
                raise StudyError(f"a seed is a whole number from 0 to 2^63 - 1, got {seed!r}")
        for name in ("episodes", "steps"):
            value = getattr(self, name)
            if value is not None and not _is_count(value, 1):
                raise StudyError(f"{name} must be a whole number of 1 or more, got {value!r}")
        if self.train and not {PPO, SCRIPTED} & set(self.policies):
            raise StudyError(f"train means nothing to policies that are there already: {', '.join(self.policies)}")
        if self.steps is not None and PPO not in self.policies:
            raise StudyError(f"steps={self.steps} means nothing without the policy {PPO!r}")

    @property
    def act_laws(self) -> tuple[StatedLaw, ...]:
        """Laws to act under."""
        return tuple(map(read_law, self.act))

    @property
    def train_laws(self) -> tuple[StatedLaw, ...]:
        """Laws to make policies for."""
        return tuple(map(read_law, self.train or self.act))

    @property
    def training_steps(self) -> int:
        """Number of steps of a training."""
        return _STEPS if self.steps is None else self.steps

    def _check_several(self, name: str) -> None:
        values = getattr(self, name)
        if not isinstance(values, tuple):
            raise StudyError(f"{name} is a tuple, such as ({values!r},), got {type(values).__name__} {values!r}")
        if not values and name not in ("train", "schemes"):
            raise StudyError(f"{name} is empty: there is nothing to run")
        for value in values if name in ("tasks", "policies") else ():
            if not isinstance(value, str):
                raise StudyError(f"{name} are texts, such as {_EXAMPLES[name]!r}, got {value!r}")
        told = [str(read_law(value).settings()) if name in ("act", "train") else value for value in values]
        twice = [value for i, value in enumerate(values) if told[i] in told[:i]]
        if twice:
            raise StudyError(f"{name} has {twice[0]!r} twice")


def quick_study() -> Study:
    """Return a study without training, of the scripted controllers on this package's own tasks."""
    return Study(
        tasks=tuple(f"impactlaw/{name}-v0" for name in ("Juggler", "Billiards", "NewtonsCradle", "RockingBlock")),
        train=("moreau:0.5", "moreau:0.8", "moreau:0.95"),
        act=("maximal-dissipation", "moreau:0.5", "moreau:0.8", "moreau:0.95", "reversal:1"),
        policies=(SCRIPTED,),
        episodes=2,
    )


def _is_count(value: object, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least
