"""Find the policies that a study names, and make controllers of them."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from impactlaw.errors import StudyError, UnknownNameError, check_installed
from impactlaw.studies.environments import Conditions, is_own
from impactlaw.studies.laws import StatedLaw
from impactlaw.studies.policies.controllers import CONTROLLERS
from impactlaw.studies.policies.training import load
from impactlaw.studies.study import PPO, SCRIPTED, Scheme

Controller = Callable[[Any], Any]


@dataclass(frozen=True)
class Policy:
    """The policy of a row of the transfer matrix."""

    name: str  # name in the study
    made_for: str  # text of the law that it is trained under or tuned to; empty if not made for a law of the study
    settings: dict[str, Any]  # plain values that identify the policy
    # a function of the observation, a class of such functions, or a trained file; None if it is to be trained under
    # `training`
    content: Controller | type | partial | bytes | None = None
    training: Conditions | None = None  # conditions under which to train it


def policies_of(name: str, task: str, scheme: Scheme, laws: Sequence[StatedLaw]) -> list[Policy]:
    """Return the policies that a name stands for on a task: one for each law, if they are made for laws, else one.

    Raises:
        UnknownNameError: the name is not of a known kind.
        StudyError: there is no such policy.
        MissingExtraError: the policy needs a package that is not installed.
    """
    if name == PPO:
        check_installed("stable-baselines3", f"training by {PPO!r}", "train")
        each = [Conditions(task, law, scheme) for law in laws]
        return [Policy(PPO, own.law.text, {"policy": PPO, "under": own.settings()}, training=own) for own in each]
    if name == SCRIPTED:
        return _scripted(task, laws)
    if name.endswith(".zip"):
        return [_from_file(Path(name), name)]
    if ":" in name:
        return [_imported(name)]
    raise UnknownNameError("policy", name, [PPO, SCRIPTED, "module:name", "file.zip"])


def opened(content: Controller | type | partial | bytes) -> Callable[[], Controller]:
    """Return a function that returns the controller of a new episode."""
    if isinstance(content, bytes):
        act = load(io.BytesIO(content))
        return lambda: act
    if isinstance(content, type | partial):
        return content
    return lambda: content


def _scripted(task: str, laws: Sequence[StatedLaw]) -> list[Policy]:
    short = task.rpartition("/")[2]
    if short not in CONTROLLERS or not is_own(task):
        known = ", ".join(f"impactlaw/{name}" for name in CONTROLLERS)
        raise StudyError(f"there is no scripted controller of {task!r}; there are those of {known}")
    made = CONTROLLERS[short]
    settings = {"policy": SCRIPTED, "task": short, "source": _source(made)}
    if "restitution" not in inspect.signature(made).parameters:
        return [Policy(SCRIPTED, "", settings, made)]
    policies = []
    for law in laws:
        e = law.coefficient
        if e is None:
            raise StudyError(f"the scripted controller of {task!r} is tuned to one coefficient; {law.text!r} has none")
        policies.append(Policy(SCRIPTED, law.text, settings | {"restitution": e}, partial(made, restitution=e)))
    return policies


def _from_file(path: Path, name: str) -> Policy:
    check_installed("stable-baselines3", f"the trained policy {name}", "train")
    try:
        content = path.read_bytes()
        load(io.BytesIO(content))
    except OSError as error:
        raise StudyError(f"cannot read the policy {name}: {error.strerror}") from None
    except StudyError as error:
        raise StudyError(f"{name} is no trained policy: {error}") from None
    return Policy(name, "", {"policy": "file", "content": hashlib.sha256(content).hexdigest()}, content)


def _imported(name: str) -> Policy:
    module, _, attribute = name.partition(":")
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise StudyError(f"there is no policy {name!r}: {error}") from None
    if not callable(found):
        raise StudyError(f"the policy {name!r} is no function of the observation, but {found!r}")
    return Policy(name, "", {"policy": name, "source": _source(found)}, found)


def _source(found: Any) -> str | None:
    """Return a digest of the source file of a function or class, so that an edited policy counts as another one."""
    place = inspect.getmodule(found if inspect.isroutine(found) or isinstance(found, type) else type(found))
    try:
        return None if place is None else hashlib.sha256(inspect.getsource(place).encode()).hexdigest()
    except (OSError, TypeError):
        return None
