"""The law that an environment is under, its own or one put there; it can be set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from impactlaw.envs.episode_seeds import EpisodeSeeds
from impactlaw.envs.law_options import LawOptions
from impactlaw.errors import RestitutionError
from impactlaw.laws import LAWS, Law, takes_restitution
from impactlaw.stepping.stepper import Stepper


class LawInForce:
    """What steps under a law: what was asked for, what is in force in this episode, and the stepper made of that."""

    _options: LawOptions
    _in_force: LawOptions
    _stepper: Stepper
    seeds: EpisodeSeeds
    """Of outcomes, for laws that draw them."""

    @property
    def law(self) -> Law:
        """The law in force; set it, to what the argument takes, and it is in force from the next step on.

        Raises:
            UnknownNameError: as where it was given, and the law stays what it was.
            RestitutionError: as where it was given, and the law stays what it was.
        """
        return self._stepper.law

    @law.setter
    def law(self, law: str | Law | Mapping[str, Any]) -> None:
        with way_out(goes_with_restitution(law)):
            self._set(law=law, restitution=None)

    @property
    def restitution(self) -> Any:
        """The restitution as it was given, None for the scene's own; set it, and the law by its name has that."""
        return self._options.restitution

    @restitution.setter
    def restitution(self, restitution: Any) -> None:
        with way_out(not goes_with_restitution(self._options.law)):
            self._set(restitution=restitution)

    @property
    def in_force(self) -> LawOptions:
        """The law and options of this episode."""
        return self._in_force

    def use(self, options: LawOptions) -> None:
        """Let these be in force."""
        self._stepper = options.changed_stepper(self._stepper, self._in_force)
        self._in_force = options

    def _set(self, **changes: Any) -> None:
        """Change what stands, and what is in force, or nothing if either cannot have it."""
        standing = replace(self._options, **changes)
        if self._in_force is self._options:
            in_force = standing
        else:  # this episode has something of its own, so that `use` does not look at what stands
            standing.stepper(self._stepper.model)
            in_force = replace(self._in_force, **changes)
        with self.seeds.begun(None):
            self.use(in_force.seeded(self.seeds))
        self._options = standing


def goes_with_restitution(law: Any) -> bool:
    """Return whether a law, as it was given, is a name that a restitution goes with."""
    return isinstance(law, str) and law in LAWS and takes_restitution(law)


@contextmanager
def way_out(is_needed: bool, owner: str = "env") -> Iterator[None]:
    """Let an error say, too, how a law and its restitution are set together."""
    try:
        yield
    except RestitutionError as error:
        if not is_needed:
            raise
        raise RestitutionError(f"{error}; set a law with its restitution, such as {owner}.law = Newton(0.7)") from None
