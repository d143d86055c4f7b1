"""The cells of a study, each with a key derived from its settings, and the jobs of workers."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from impactlaw.errors import ImpactLawError
from impactlaw.studies.environments import Conditions, usual_scheme
from impactlaw.studies.play import episode_seeds, play, training_seed
from impactlaw.studies.policies.named import Policy, opened, policies_of
from impactlaw.studies.policies.training import ENVIRONMENTS, PPO_SETTINGS, train
from impactlaw.studies.study import Study

_ALONE = threading.Lock()  # one job at a time: torch's generator and thread limits belong to the whole process
_VERSIONS = {name: importlib.metadata.version(name) for name in ("impactlaw", "mujoco")}


class _Keyed:
    settings: Any

    @property
    def key(self) -> str:
        """A digest of the settings."""
        return hashlib.sha256(json.dumps(self.settings, sort_keys=True).encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Training(_Keyed):
    """The training of a policy."""

    conditions: Conditions  # task, law and scheme of the training
    steps: int  # number of steps
    seed: int  # seed of the study

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values."""
        how = {"environments": ENVIRONMENTS, **PPO_SETTINGS}
        return {"training": self.conditions.settings(), "steps": self.steps, "seed": self.seed, **how, **_VERSIONS}

    def work(self) -> bytes:
        """Train, and return the policy as the content of a file."""
        return train(self.conditions, self.steps, training_seed(self.seed))

    def __str__(self) -> str:
        c = self.conditions
        return f"training on {c.task} under {c.law.text} ({c.scheme}), seed {self.seed}"


@dataclass(frozen=True)
class Cell(_Keyed):
    """Episodes of a policy under a law."""

    conditions: Conditions  # task, law and scheme of the episodes
    policy: Policy  # the policy
    seed: int  # seed of the study
    episodes: int  # number of episodes
    training: Training | None = None  # training of the policy; None if the policy needs none

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values."""
        policy = self.policy.settings if self.training is None else self.training.settings
        acting = {"acting": self.conditions.settings(), "policy": policy}
        return acting | {"seed": self.seed, "episodes": self.episodes, **_VERSIONS}

    def names(self) -> dict[str, Any]:
        """Return the columns of the table that identify the cell."""
        return {
            "task": self.conditions.task,
            "scheme": self.conditions.scheme,
            "policy": self.policy.name,
            "trained_under": self.policy.made_for,
            "acted_under": self.conditions.law.text,
            "seed": self.seed,
            "episodes": self.episodes,
        }

    def work(self, trained: bytes | None = None) -> dict[str, float]:
        """Play the episodes; `trained` is the file of the trained policy, if the policy had to be trained."""
        content = self.policy.content if trained is None else trained
        assert content is not None
        return play(self.conditions, opened(content), episode_seeds(self.seed, self.episodes))

    def __str__(self) -> str:
        c, made_for = self.conditions, f" made for {self.policy.made_for}" if self.policy.made_for else ""
        return f"{self.policy.name}{made_for} on {c.task} under {c.law.text} ({c.scheme}), seed {self.seed}"


def cells_of(study: Study) -> Iterator[Cell]:
    """Yield the cells of a study in the order of its table."""
    for task in study.tasks:
        for scheme, name in product(study.schemes or (usual_scheme(task),), study.policies):
            policies = policies_of(name, task, scheme, study.train_laws)
            for policy, law, seed in product(policies, study.act_laws, study.seeds):
                under = policy.training
                training = None if under is None else Training(under, study.training_steps, seed)
                yield Cell(Conditions(task, law, scheme), policy, seed, study.episodes, training)


def attempt(key: str, name: str, work: Callable[[], Any]) -> tuple[str, Any, str | None]:
    """Do the work with one thread, so that machines agree; return the key, the result, and the failure as text.

    A failure in a worker is returned, not raised, since not all exceptions can be sent to another process.
    """
    with _ALONE, threadpool_limits(1):
        try:
            return key, work(), None
        except ImpactLawError as error:
            return key, None, f"{name}: {error}"
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}:{last.lineno}"
            return key, None, f"{name}: {type(error).__name__}: {error} (at {place})"


def job(of: Training | Cell, trained: bytes | None = None) -> Callable[[], tuple[str, Any, str | None]]:
    """Return the function that a worker has to call."""
    work = partial(of.work, trained) if isinstance(of, Cell) else of.work
    return partial(attempt, of.key, str(of), work)
