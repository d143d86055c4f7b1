"""Draw another law, or another restitution, for every episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from impactlaw.envs.episode_seeds import LAWS, EpisodeSeeds
from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_holder import law_holder
from impactlaw.envs.law_options import describe_law
from impactlaw.errors import OptionError, SettledError
from impactlaw.laws import Law
from impactlaw.settled import Settled
from impactlaw.stepping.stepper import Stepper

_INSTEAD = "pass it to reset(options=...), for an episode, or put another RandomLaw around the environment"


def _in_force(name: str, found: Callable[[Stepper], Any]) -> property:
    """Return a read-only property of the wrapped environment: the next reset would overwrite an assigned value."""

    def get(self: RandomLaw) -> Any:
        return found(law_holder(self.env).stepper)

    def refuse(self: RandomLaw, value: Any) -> None:
        raise SettledError(f"{name} of {type(self).__name__} cannot be set to {value!r:.100}: it is drawn; {_INSTEAD}")

    return property(get, refuse, doc=f"The {name} in force; WrapperError if the law was removed.")


class RandomLaw(gymnasium.Wrapper, RecordConstructorArgs):
    """A wrapper that draws a law at each reset, so that a policy experiences many laws.

    ``RandomLaw(ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5), laws=("moreau", "poisson"))``. It wraps an
    `ImpactLaw` or an environment of this package, with or without other wrappers in between, and resets it with
    ``options={"law": .., "restitution": ..}``. ``info`` names the law and restitution in force.

    The wrapper draws from its own generator, which ``reset(seed=...)`` seeds, so that episodes start as they do without
    the wrapper. Options given to a reset take precedence. A given "law" has the restitution given with it, or none; a
    given "restitution" is combined with a law drawn among those that take one. The arguments are fixed at construction;
    assigning to them, or to the law, is an error.

    Args:
        env: the environment.
        laws: laws to choose from; for this and the following arguments see `LawDistribution`.
        restitution: ``(low, high)``, a list to choose from, a frozen distribution of scipy.stats, or None.
        friction: options of rigid contact to choose from, or None.

    Raises:
        WrapperError: the environment has no impact law.
        ImpactLawError: as raised by `LawDistribution`.
    """

    laws = Settled(_INSTEAD)
    law = _in_force("law", lambda stepper: stepper.law)
    restitution = _in_force("restitution", lambda stepper: describe_law(stepper.law).get("impact/restitution"))
    friction = _in_force("friction", lambda stepper: stepper.friction)

    def __init__(
        self,
        env: gymnasium.Env,
        laws: Sequence[str | Law | Mapping[str, Any]] = ("moreau",),
        restitution: Any = (0.4, 1.0),
        friction: Sequence[str] | None = None,
    ):
        self._laws = LawDistribution(laws, restitution, friction)
        RecordConstructorArgs.__init__(self, **self._laws.arguments())
        super().__init__(env)
        law_holder(env)
        self.laws = self._laws.laws
        self._seeds = EpisodeSeeds(LAWS)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode under a law drawn at random.

        Args:
            seed: seed of the environment, and of the laws drawn from now on.
            options: options of the environment; they take precedence over drawn ones.

        Raises:
            WrapperError: the law of the wrapped environment was removed.
            OptionError: the options are not a mapping, or the seed is not a nonnegative integer.
            ImpactLawError: as raised by the reset of the environment.
        """
        if options is not None and not isinstance(options, Mapping):
            raise OptionError(f"options of a reset are a mapping, got {options!r}")
        law_holder(self.env)
        with self._seeds.begun(seed):
            drawn = self._laws.draw(self._seeds.generator, options or ())
            return self.env.reset(seed=seed, options=drawn | dict(options or {}))
