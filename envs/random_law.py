"""Another law, or another restitution, in every episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from impactlaw.envs.episode_seeds import LAWS, EpisodeSeeds
from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_holder import law_holder
from impactlaw.errors import OptionError, SettledError
from impactlaw.laws import Law
from impactlaw.settled import Settled

_INSTEAD = "pass it to reset(options=...), for an episode, or put another RandomLaw around the environment"


def _inside(name: str) -> property:
    """Return what the environment inside has; it cannot be set here, since the next reset would draw over it."""

    def get(self: RandomLaw) -> Any:
        return self.env.get_wrapper_attr(name)

    def refuse(self: RandomLaw, value: Any) -> None:
        raise SettledError(f"{name} of {type(self).__name__} cannot be set to {value!r:.100}: it is drawn; {_INSTEAD}")

    return property(get, refuse, doc=f"The {name} in force, as the environment inside says.")


class RandomLaw(gymnasium.Wrapper, RecordConstructorArgs):
    """Draws the law of each episode, at its reset, so that a policy meets many of them.

    ``RandomLaw(ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5), laws=("moreau", "poisson"))``. It goes around an
    `ImpactLaw`, or an environment of this package, perhaps with other wrappers in between, and resets it with
    ``options={"law": .., "restitution": ..}``: ``info`` names what is in force.

    ``reset(seed=...)`` seeds what is drawn from then on, by a generator of its own: episodes start as they do without
    this wrapper. Options that a reset is given come first: a "law" that is given has the restitution that is given with
    it, or none; "restitution" goes with a law that is drawn among those that take one. What it draws from is settled
    when it is made; setting that, or a law, is an error.

    Args:
        env: the environment.
        laws: see `LawDistribution`, like the arguments below.
        restitution: ``(low, high)``, a list to choose from, a frozen distribution of scipy.stats, or None.
        friction: options of rigid contact to choose from, or None.

    Raises:
        WrapperError: the environment has no impact law.
        OptionError: there is nothing to choose from, or the distribution reaches beyond [0, 1].
        UnknownNameError: no such law.
        RestitutionError: a law cannot have such a restitution.
    """

    laws = Settled(_INSTEAD)
    law, restitution, friction = _inside("law"), _inside("restitution"), _inside("friction")

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
        """Start an episode under a law that is drawn.

        Args:
            seed: of the environment, and of what is drawn from now on.
            options: as the environment takes them; they come before what is drawn.

        Raises:
            WrapperError: the law inside was removed.
            OptionError: the options are not a mapping.
            ImpactLawError: as by the reset of the environment.
        """
        if options is not None and not isinstance(options, Mapping):
            raise OptionError(f"options of a reset are a mapping, got {options!r}")
        law_holder(self.env)
        with self._seeds.begun(seed):
            drawn = self._laws.draw(self._seeds.generator, options or ())
            return self.env.reset(seed=seed, options=drawn | dict(options or {}))
