"""The law in force in an environment, its own or one put into it, with setters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from impactlaw.envs.episode_seeds import EpisodeSeeds
from impactlaw.envs.law_options import LawOptions, describe_law
from impactlaw.errors import RestitutionError
from impactlaw.laws import LAWS, Law, takes_restitution
from impactlaw.stepping.stepper import Stepper


class LawInForce:
    """Base class of owners of a law: the standing options, the options of this episode, and the stepper under these.

    A reset may change the options for one episode; the standing options are those to which the next reset returns.
    """

    _options: LawOptions
    _in_force: LawOptions
    _stepper: Stepper
    seeds: EpisodeSeeds
    """Seeds for laws that draw their outcomes."""
    _named: tuple[Law | None, dict[str, Any]] = None, {}

    @property
    def law(self) -> Law:
        """The law in force; assign anything that the argument `law` accepts, to be in force from the next step on.

        What that argument would refuse is refused here, too, and then the law does not change.
        """
        return self._stepper.law

    @law.setter
    def law(self, law: str | Law | Mapping[str, Any]) -> None:
        with way_out(goes_with_restitution(law)):
            self._set(law=law, restitution=None)

    @property
    def restitution(self) -> Any:
        """The restitution as given, None for the scene's own; assigning to it changes that of a law given by name."""
        return self._options.restitution

    @restitution.setter
    def restitution(self, restitution: Any) -> None:
        with way_out(not goes_with_restitution(self._options.law)):
            self._set(restitution=restitution)

    @property
    def stepper(self) -> Stepper:
        """The stepper of this episode."""
        return self._stepper

    @property
    def in_force(self) -> LawOptions:
        """The law and options of this episode."""
        return self._in_force

    def _law_info(self) -> dict[str, Any]:
        """Return the entries of ``info`` about the law in force, which are made once for each law."""
        if self._named[0] is not self.law:
            self._named = self.law, describe_law(self.law)
        return self._named[1]

    def use(self, options: LawOptions) -> None:
        """Put options into force for this episode."""
        before, model = self._in_force, self._stepper.model
        if (options.friction, options.scheme) != (before.friction, before.scheme):
            self._stepper = options.stepper(model)
        elif options is not before:
            self._stepper.law = options.law_for(model)
        self._in_force = options

    def _set(self, **changes: Any) -> None:
        """Change the standing options and those in force; if either change is refused, change neither."""
        standing = replace(self._options, **changes)
        if self._in_force is self._options:
            in_force = standing
        else:  # this episode has its own options, so `use` would not check the standing ones
            standing.stepper(self._stepper.model)
            in_force = replace(self._in_force, **changes)
        with self.seeds.begun(None):
            self.use(in_force.seeded(self.seeds))
        self._options = standing


def goes_with_restitution(law: Any) -> bool:
    """Return whether a law was given as the name of a law that takes a restitution."""
    return isinstance(law, str) and law in LAWS and takes_restitution(law)


@contextmanager
def way_out(is_needed: bool, owner: str = "env") -> Iterator[None]:
    """Extend a RestitutionError, if needed, by a hint on how to set a law together with its restitution."""
    try:
        yield
    except RestitutionError as error:
        if not is_needed:
            raise
        raise RestitutionError(f"{error}; set a law with its restitution, such as {owner}.law = Newton(0.7)") from None
