"""A distribution of laws and restitutions, from which each episode draws one of each."""

from __future__ import annotations

import numbers
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlaw.errors import OptionError, RestitutionError, UnknownNameError
from impactlaw.laws import Law, make_law, portable, restored, takes_restitution
from impactlaw.stepping.compatibility import FRICTION

_UNIFORM, _SCIPY = "uniform", "scipy"
"""Keys of a distribution that is written as plain values."""


@dataclass(frozen=True, eq=False)
class LawDistribution:
    """A uniform distribution over laws, with a distribution of their restitution.

    Attributes:
        laws: names of laws, which may include "scene", files such as law.json, or `Law` objects.
        restitution: a tuple of two numbers, or ``{"uniform": [low, high]}`` as in YAML and JSON, which have no tuples,
            for the uniform distribution on this interval in [0, 1]; a list, or any other sequence, of arguments of laws
            to choose from; a frozen distribution of `scipy.stats` on [0, 1]; or None for the scene's own. No
            restitution is drawn for laws that take none, such as "maximal-dissipation" and "any-outcome", or for `Law`
            objects, which have their own.
        friction: options of rigid contact to choose from, "coulomb", "convex", "ignore"; None to leave it unchanged.

    Raises:
        OptionError: a list to choose from is empty, or the distribution reaches beyond [0, 1].
        UnknownNameError: there is no such law, or no such option of friction.
        RestitutionError: a law cannot have such a restitution.
    """

    laws: Sequence[str | Law | Mapping[str, Any]] = ("moreau",)
    restitution: Any = (0.4, 1.0)
    friction: Sequence[str] | None = None

    def __post_init__(self):
        if isinstance(self.laws, Law) or not _is_choice(self.laws):
            raise OptionError(f'laws is a sequence of laws to choose from, such as ("moreau",), got {self.laws!r}')
        object.__setattr__(self, "laws", tuple(map(_read, self.laws)))
        object.__setattr__(self, "restitution", _distribution(self.restitution))
        if self.friction is not None:
            if not _is_choice(self.friction):
                raise OptionError(f'friction is a sequence to choose from, such as ["coulomb"], got {self.friction!r}')
            for option in self.friction:
                if option not in FRICTION:
                    raise UnknownNameError("friction option", option, FRICTION)
            object.__setattr__(self, "friction", tuple(self.friction))
        examples = self._examples()
        object.__setattr__(self, "_takes", tuple(_takes_restitution(law, examples) for law in self.laws))

    def draw(self, rng: np.random.Generator, given: Iterable[str] = ()) -> dict[str, Any]:
        """Draw options of a reset: "law", "restitution" if that law takes one, and "friction".

        Args:
            rng: random generator; the number of draws does not depend on `given`.
            given: names of options that the caller provides, which are not returned. With a given law no restitution is
                returned; with a given restitution the law is drawn among those that take one.
        """
        given, takes = set(given), self._takes  # pyright: ignore[reportAttributeAccessIssue]
        fitting = [i for i, own in enumerate(takes) if own] if "restitution" in given else []
        which = fitting or range(len(self.laws))
        i, e = which[int(rng.random() * len(which))], self._restitution(rng)
        found: dict[str, Any] = {"law": self.laws[i]}
        if takes[i] and e is not None:
            found["restitution"] = e
        if self.friction is not None:
            found["friction"] = self.friction[int(rng.random() * len(self.friction))]
        if "law" in given:
            found.pop("restitution", None)
        return {name: value for name, value in found.items() if name not in given}

    def examples(self) -> list[dict[str, Any]]:
        """Return options of a reset for each of the laws, each with one restitution if the law takes one."""
        takes, ends = self._takes, self._examples()  # pyright: ignore[reportAttributeAccessIssue]
        return [
            {"law": law} | ({"restitution": ends[0]} if own else {}) for law, own in zip(self.laws, takes, strict=True)
        ]

    def arguments(self) -> dict[str, Any]:
        """Return constructor arguments that make the same distribution, as plain values where possible."""
        e = self.restitution
        if isinstance(e, tuple):
            e = {_UNIFORM: list(e)}
        elif hasattr(e, "rvs"):
            e = {_SCIPY: e.dist.name, "args": portable(e.args), "kwds": {k: portable(v) for k, v in e.kwds.items()}}
        elif e is not None:
            e = [_plain(one) for one in e]
        friction = None if self.friction is None else list(self.friction)
        return {"laws": [_plain(law) for law in self.laws], "restitution": e, "friction": friction}

    def _restitution(self, rng: np.random.Generator) -> Any:
        e = self.restitution
        if isinstance(e, tuple):
            return float(e[0] + (e[1] - e[0]) * rng.random())
        if hasattr(e, "rvs"):
            return float(e.rvs(random_state=rng))
        return None if e is None else e[int(rng.random() * len(e))]

    def _examples(self) -> list[Any]:
        e = self.restitution
        if isinstance(e, tuple):
            return list(e)
        if hasattr(e, "rvs"):
            return [float(end) for end in e.support()]
        return [] if e is None else list(e)


def is_written(law: Any) -> bool:
    """Return whether a value is what `LawDistribution.arguments` returns, as read from the JSON of a spec."""
    return isinstance(law, Mapping) and "laws" in law


def _is_choice(value: Any) -> bool:
    """Return whether a value is a nonempty ordered collection; the order of a set differs between processes."""
    ordered = isinstance(value, Sequence) or (isinstance(value, np.ndarray) and value.ndim > 0)
    return ordered and not isinstance(value, str | bytes) and len(value) > 0


def _distribution(value: Any) -> Any:
    """Return a restitution in [0, 1] as an interval (low, high), a list of choices, a frozen distribution or None."""
    if isinstance(value, Mapping):
        value = _from_plain(value)
    if hasattr(value, "rvs"):
        if not hasattr(value, "support") or not hasattr(value, "dist"):
            raise OptionError(f"a distribution is a frozen one of scipy.stats, such as beta(2, 5), got {value!r}")
        low, high = value.support()  # pyright: ignore[reportAttributeAccessIssue]
        if not 0.0 <= low <= high <= 1.0:
            raise OptionError(
                f"restitution lies in [0, 1], but the distribution reaches from {low:g} to {high:g}; take one that "
                "does not, such as scipy.stats.beta, truncnorm or uniform"
            )
        return value
    if isinstance(value, tuple) and len(value) == 2 and all(isinstance(end, numbers.Real) for end in value):
        low, high = map(float, value)
        if not 0.0 <= low <= high <= 1.0:
            raise OptionError(f"an interval of restitution is (low, high) with 0 <= low <= high <= 1, got {value}")
        return low, high
    if value is None:
        return None
    if not _is_choice(value):
        raise OptionError(
            "restitution is an interval (low, high), a list to choose from, a frozen distribution of scipy.stats or "
            f"None, got {value!r}"
        )
    return [restored(one) for one in value]


def _from_plain(written: Mapping[str, Any]) -> Any:
    """Return the interval, or the distribution of scipy.stats, that is written as plain values."""
    try:
        if written.keys() == {_UNIFORM}:
            low, high = map(operator.pos, written[_UNIFORM])  # texts are no numbers
            return float(low), float(high)
        import scipy.stats

        return getattr(scipy.stats, written[_SCIPY])(*written["args"], **written["kwds"])
    except (AttributeError, KeyError, TypeError, ValueError):
        raise OptionError(
            f'a distribution as plain values is an interval {{"uniform": [low, high]}}, got {dict(written)!r:.200}'
        ) from None


def _read(law: Any) -> Any:
    """Return the law of a file, or that of plain values; a name stays as it is."""
    return make_law(law) if str(law).endswith(".json") else restored(law)


def _takes_restitution(law: Any, examples: list[Any]) -> bool:
    """Return whether a law takes a restitution; raise if it takes one, but not one of the examples."""
    if law == "scene" or not takes_restitution(law):
        return False
    for e in examples:
        make_law(law, e)
    return bool(examples)


def _plain(value: Any) -> Any:
    try:
        return portable(value)
    except RestitutionError:  # writing JSON will report it
        return value
