"""The options of an environment's law and stepper, and those of them that a reset may change."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import mujoco
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

from impactlaw.envs.episode_seeds import EpisodeSeeds
from impactlaw.envs.law_distribution import LawDistribution, is_written
from impactlaw.errors import OptionError, PassedOnWarning, RestitutionError, SceneError, UnknownNameError
from impactlaw.laws import LAWS, Law, make_law, portable, restored
from impactlaw.laws.restitution.from_scene import scene_law, scene_restitution
from impactlaw.recording.properties import law_name, law_restitution
from impactlaw.stepping.stepper import Stepper

RESET = ("law", "restitution", "friction", "scheme")
"""Keys of ``reset(options=...)``."""

_LONGEST = 200  # characters of a law's text in info, which is sent between processes at every step


@dataclass(frozen=True, kw_only=True, eq=False)
class LawOptions:
    """The options of environments, `ImpactLaw` and `put_law`; see there."""

    law: str | Law | Mapping[str, Any]
    restitution: Any = None
    contact_model: Literal["rigid", "soft"] = "soft"
    scheme: Literal["event-driven", "time-stepping"] | None = None
    friction: Literal["coulomb", "convex", "ignore"] | None = None
    rest_speed: float | None = None
    on_inadmissible: Literal["raise", "project", "allow"] = "project"
    usual_scheme: Literal["event-driven", "time-stepping"] = "time-stepping"  # scheme of rigid contact if none is given
    overlap: Literal["refuse", "push-out"] | None = "push-out"  # option of `Stepper`, used if contact is rigid
    contacts: str | Sequence[str] | None = None
    limits: bool = True
    impulse_in_cfrc_ext: bool = False
    seed: int | None = None  # seed of this episode, for a law that draws its outcomes and has no seed of its own

    @property
    def scheme_in_force(self) -> Literal["event-driven", "time-stepping"] | None:
        """The scheme of rigid contact, given or default; for soft contact the scheme as given, normally None."""
        return (self.scheme or self.usual_scheme) if self.contact_model == "rigid" else self.scheme

    def law_for(self, model: mujoco.MjModel) -> Law | Literal["scene"]:
        """Return the law for a stepper of a model, with the seed of this episode if there is one."""
        law = choose_law(model, self.law, self.restitution)
        if isinstance(self.law, str) and self.law == "scene":
            return "scene"  # the stepper follows changes of what the scene carries
        return law if self.seed is None else law.seeded(self.seed)

    @cached_property
    def draws(self) -> bool:
        """Whether the law draws its outcomes, and has no seed of its own."""
        try:
            law = make_law(self.law, self.restitution)
        except (RestitutionError, UnknownNameError):  # the law depends on the scene, or does not exist
            return False
        return law.seeded(0) is not law

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """Return a stepper for the model.

        Raises:
            SceneError: an option has no meaning for this contact model or scheme.
            OptionError: impulse_in_cfrc_ext is neither True nor False.
        """
        rigid = self.contact_model == "rigid"
        if not isinstance(self.impulse_in_cfrc_ext, bool):
            raise OptionError(f"impulse_in_cfrc_ext is True or False, got {self.impulse_in_cfrc_ext!r}")
        if self.impulse_in_cfrc_ext and rigid and self.scheme_in_force == "event-driven":
            raise SceneError(
                "impulse_in_cfrc_ext means nothing to event-driven steps, which leave no forces of contact; use "
                'scheme="time-stepping" or contact_model="soft"'
            )
        return Stepper(
            model, self.law_for(model), contact_model=self.contact_model, scheme=self.scheme_in_force,
            friction=self.friction, overlap=self.overlap if rigid else None, contacts=self.contacts,
            limits=self.limits, rest_speed=self.rest_speed, on_inadmissible=self.on_inadmissible,
        )  # fmt: skip

    def for_reset(self, options: Mapping[str, Any] | None, seeds: EpisodeSeeds) -> LawOptions:
        """Return the options in force in an episode that a reset begins.

        Args:
            options: options of the reset; a law given without a restitution does not keep the standing one.
            seeds: source of seeds for a law that draws its outcomes.
        """
        given = {name: value for name, value in (options or {}).items() if name in RESET}
        if "law" in given:
            given.setdefault("restitution", None)
        asked, seed = replace(self, **given) if given else self, seeds.draw()
        return replace(asked, seed=seed) if asked.draws else asked

    def seeded(self, seeds: EpisodeSeeds) -> LawOptions:
        """Return these options, with a seed if the law needs one."""
        return replace(self, seed=seeds.draw()) if self.draws else self

    def settings(self, law: Law) -> dict[str, Any] | None:
        """Return reset options that restore this law, and the contact model, as plain values.

        Return None if the law cannot be written as plain values.
        """
        plain = as_plain(law)
        if plain is None:
            return None
        scheme, kind = self.scheme_in_force, self.contact_model
        given = {"law": plain, "friction": self.friction, "scheme": scheme, "contact_model": kind}
        return {name: value for name, value in given.items() if value is not None}


def as_plain(law: Law) -> Any:
    """Return a law as plain values; None if it cannot be written so."""
    try:
        return portable(law)
    except RestitutionError:
        return None


def check_reset(options: Mapping[str, Any] | None, known: Sequence[str] = RESET) -> None:
    """Check that no option of a reset would be ignored.

    Raises:
        UnknownNameError: there is no such option.
        OptionError: the options are not a mapping.
    """
    if options is not None and not isinstance(options, Mapping):
        raise OptionError(f"options of a reset are a mapping of {', '.join(known)} to values, got {options!r}")
    for name in options or ():
        if name not in known:
            raise UnknownNameError("option of reset", name, known)


def warn_of_slips(options: Mapping[str, Any] | None) -> None:
    """Warn of options of a reset for the wrapped environment that nearly have the name of one of `RESET`."""
    for name in options or ():
        near = difflib.get_close_matches(str(name).lower(), RESET, n=1, cutoff=0.8)
        if near and name not in RESET:
            warnings.warn(
                f"option of reset {name!r} is passed on to the wrapped environment; did you mean {near[0]!r}?",
                PassedOnWarning,
                stacklevel=3,
            )


def choose_law(model: mujoco.MjModel, law: str | Law | Mapping[str, Any], restitution: Any = None) -> Law:
    """Return the law described by the arguments of an environment.

    Args:
        model: the scene.
        law: a `Law`, its name, or "scene" for the restitution that the MJCF carries pair by pair.
        restitution: argument of the law; the scene's default coefficient if the law needs one and none is given.

    Raises:
        UnknownNameError: there is no such law.
        OptionError: law is a `LawDistribution`.
        RestitutionError: the restitution does not fit the law, or neither the argument nor the scene gives one.
    """
    if isinstance(law, LawDistribution):
        raise OptionError(
            "a LawDistribution is not a law: RandomLaw(env, laws, restitution) draws from one, around each single "
            "environment; compiled worlds take one when they are made, as law=... of make_vec"
        )
    if isinstance(law, str) and law == "scene":
        if restitution is not None:
            raise RestitutionError(f"law 'scene' takes its restitution from the scene, got {restitution!r} too")
        return scene_law(model)
    try:
        return make_law(law, restitution)
    except UnknownNameError:
        if isinstance(law, Mapping) or str(law).endswith(".json"):  # the unknown name is inside the mapping or file
            raise
        raise UnknownNameError("law", law, (*LAWS, "scene")) from None
    except RestitutionError:
        own = scene_restitution(model)
        if restitution is not None or own is None:
            raise
        return make_law(law, own)


def describe_law(law: Law) -> dict[str, str | float]:
    """Return the entries of ``info`` about a law: its text, and its coefficient of restitution if it has exactly one.

    Otherwise the coefficient is left out: NaN would make equal episodes differ, also for gymnasium's `check_env`.
    """
    e = law_restitution(law)
    text = law_name(law) or ""
    text = text if len(text) <= _LONGEST else f"{type(law).__name__}(...)"
    return {"impact/law": text} | ({"impact/restitution": e} if isinstance(e, float) else {})


def portable_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return constructor arguments in a form that `gymnasium.EnvSpec` can write to JSON, as far as possible."""
    result = dict(options)
    law = result.get("law")
    if isinstance(law, LawDistribution):
        result["law"] = law.arguments()
    given = {"law", "restitution"} & result.keys()
    for name in given - {"law"} if is_written(result.get("law")) else given:
        with suppress(RestitutionError):  # writing JSON will report it
            value = result[name]  # restored first, since it may come from a spec that is plain already
            result[name] = portable([restored(one) for one in value] if isinstance(value, list) else restored(value))
    if isinstance(result.get("contacts"), tuple | set | frozenset):
        result["contacts"] = list(result["contacts"])
    if result.get("log") is not None:
        result["log"] = str(result["log"])
    if isinstance(result.get("autoreset_mode"), AutoresetMode):
        result["autoreset_mode"] = result["autoreset_mode"].value
    return result


class PortableSpec:
    """What has a spec from which gymnasium makes the same again; laws in it can be written to JSON."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """The spec; its arguments are written as plain values, as far as possible."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=portable_options(spec.kwargs))
