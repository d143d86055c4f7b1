"""Measurements, limits and verdicts of the stability study.

A verdict never uses the package's report on its own result, but `scripts.stability.certificate`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch

import numpy as np

RIGHT, REFUSED, WRONG, HANGS, NAN, CRASHES = "right", "refused", "WRONG", "HANGS", "NaN", "CRASHES"
MEASURED = ("residual", "energy", "penetration", "deviation", "first_order")
"""Names of the measurements that a result is judged by."""
EITHER = "right or refused"
"""Expected of solvers at the limits of their accuracy: an answer or a refusal, but never a wrong answer."""


@dataclass(frozen=True)
class Measurement:
    """The measurements of one run, by the study's own computation.

    Attributes:
        residual: the largest error of the worst collision, see `scripts.stability.certificate`.
        energy: energy error relative to the energy of the motion.
        penetration: velocity relative to the speed (laws), or depth in m (stepping).
        deviation: distance from the closed form, in the unit that the case names; 0 without a closed form.
        first_order: the largest error in steps that are counted as time stepped: penetration relative to the size of
            what moves, or the error of a collision relative to the fastest contact so far. In these steps contacts
            slower than g h do not bounce.
        collisions: number of collisions.
        note: a remark for the table.
    """

    residual: float = 0.0
    energy: float = 0.0
    penetration: float = 0.0
    deviation: float = 0.0
    first_order: float = 0.0
    collisions: int = 0
    note: str = ""


LIMITS = Measurement(residual=1e-9, energy=1e-9, penetration=1e-9, deviation=1e-9, first_order=1e-3)
"""The largest measurements of a right result."""


@dataclass(frozen=True)
class Expected:
    """The verdict that a row should have.

    Attributes:
        verdict: right, refused, or right or refused.
        reason: why it is not "right".
        error: text that the refusal must contain, at least the type of the error.
        law: pattern of the laws that it applies to.
        solver: pattern of the solvers that it applies to.
    """

    verdict: str
    reason: str
    error: str = ""
    law: str = "*"
    solver: str = "*"

    def fits(self, found: str, reason: str) -> bool:
        """Return whether a verdict with its reason is as expected."""
        if self.verdict == EITHER and found == RIGHT:
            return True
        if found == REFUSED and self.verdict in (REFUSED, EITHER):
            return self.error in reason
        return found == self.verdict


@dataclass(frozen=True)
class Case:
    """One case of the study.

    Attributes:
        name: name in the table.
        kind: "law" or "stepping".
        measure: runs it, given the names of law and solver, and whether to be quick.
        laws: names of the laws to run it under.
        solvers: names of the solvers to run it with.
        expected: verdicts other than "right"; the first one whose patterns match a row applies.
        limits: limits of a right result.
        budget: longest time of one row, also in the full form, s.
    """

    name: str
    kind: str
    measure: Callable[[str, str, bool], Measurement] = field(repr=False)
    laws: tuple[str, ...]
    solvers: tuple[str, ...] = ("auto",)
    expected: tuple[Expected, ...] = ()
    limits: Measurement = LIMITS
    budget: float = 120.0

    def expects(self, law: str, solver: str) -> Expected:
        """Return the verdict expected of a row."""
        for expected in self.expected:
            if fnmatch(law, expected.law) and fnmatch(solver, expected.solver):
                return expected
        return Expected(RIGHT, "")


def stepped(
    name: str,
    measure: Callable[[str, bool], Measurement],
    laws: tuple[str, ...],
    *expected: Expected,
    budget: float = 300.0,
    **limits: float,
) -> Case:
    """Return a case that steps a scene; limits other than the default ones are given by name."""

    def run(law: str, solver: str, quick: bool) -> Measurement:
        return measure(law, quick)

    return Case(name, "stepping", run, laws, expected=expected, limits=replace(LIMITS, **limits), budget=budget)


class WrongRefusalError(Exception):
    """The package refuses with an invalid proof."""


def verdict(measurement: Measurement, limits: Measurement) -> tuple[str, str]:
    """Return the verdict on a measurement, and which values exceed their limits."""
    pairs = [(name, getattr(measurement, name), getattr(limits, name)) for name in MEASURED]
    broken = [name for name, value, _ in pairs if not np.isfinite(value)]
    if broken:
        return NAN, f"{', '.join(broken)} not finite"
    wrong = [f"{name} {value:.1e} > {limit:.1e}" for name, value, limit in pairs if value > limit]
    return (WRONG, "; ".join(wrong)) if wrong else (RIGHT, "")
