"""What the stability study says of a row: measurements, limits, verdicts.

A verdict never uses what the package says of its own result; instead it uses
`scripts.stability.certificate`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatch

import numpy as np

RIGHT, REFUSED, WRONG, HANGS, NAN, CRASHES = "right", "refused", "WRONG", "HANGS", "NaN", "CRASHES"
MEASURED = ("residual", "energy", "penetration", "deviation", "first_order")
"""What a result is judged by."""
EITHER = "right or refused"
"""Expected of iterative solvers at the border of what they reach: an answer or a refusal, never a wrong answer."""


@dataclass(frozen=True)
class Measurement:
    """What one run shows, by the study's own computation.

    Attributes:
        residual: the larger of momentum and complementarity error of the worst collision.
        energy: energy error relative to the energy of the motion.
        penetration: m/s relative to the speed (laws), or m beyond zero gap (stepping).
        deviation: distance from the closed form, in the unit that the case names; 0 where there is none.
        first_order: in steps counted as time stepped, penetration relative to the size, or the same as residual, next
            to the fastest contact so far: in these, what is slower than g h does not bounce.
        collisions: how many there were.
        note: a fact that the table should show.
    """

    residual: float = 0.0
    energy: float = 0.0
    penetration: float = 0.0
    deviation: float = 0.0
    first_order: float = 0.0
    collisions: int = 0
    note: str = ""


@dataclass(frozen=True)
class Limits:
    """Largest measurements of a right result, in the units of `Measurement`."""

    residual: float = 1e-9
    energy: float = 1e-9
    penetration: float = 1e-9
    deviation: float = 1e-9
    first_order: float = 1e-3


@dataclass(frozen=True)
class Expected:
    """The verdict a row should have.

    Attributes:
        verdict: right, refused, or right or refused.
        reason: why, where it is not right.
        error: what the refusal must say, the type of the error at least.
        law: pattern of the laws that it is stated for.
        solver: pattern of the solvers that it is stated for.
    """

    verdict: str
    reason: str
    error: str = ""
    law: str = "*"
    solver: str = "*"

    def fits(self, found: str, reason: str) -> bool:
        """Return whether a verdict, with its reason, is the expected one."""
        if self.verdict == EITHER and found == RIGHT:
            return True
        if found == REFUSED and self.verdict in (REFUSED, EITHER):
            return self.error in reason
        return found == self.verdict


@dataclass(frozen=True)
class Case:
    """One case of the study.

    Attributes:
        name: what the table shows.
        kind: "law" or "stepping".
        measure: runs it: law name, solver name, quick or not.
        laws: names of the laws it is run under.
        solvers: names of the solvers it is run with.
        expected: verdicts other than right; the first whose patterns match a row holds.
        limits: of a right result.
        budget: s that one row may take, in the full form.
    """

    name: str
    kind: str
    measure: Callable[[str, str, bool], Measurement] = field(repr=False)
    laws: tuple[str, ...]
    solvers: tuple[str, ...] = ("auto",)
    expected: tuple[Expected, ...] = ()
    limits: Limits = Limits()
    budget: float = 120.0

    def expects(self, law: str, solver: str) -> Expected:
        """Return the verdict expected of a row."""
        for expected in self.expected:
            if fnmatch(law, expected.law) and fnmatch(solver, expected.solver):
                return expected
        return Expected(RIGHT, "")


def stepped(
    name: str,
    measure: Callable[[str, str, bool], Measurement],
    laws: tuple[str, ...],
    *expected: Expected,
    budget: float = 300.0,
    **limits: float,
) -> Case:
    """Return a case that steps a scene, with limits other than the usual ones by the names of `Limits`."""
    return Case(name, "stepping", measure, laws, expected=expected, limits=Limits(**limits), budget=budget)


class WrongRefusalError(Exception):
    """The package refuses with a proof that proves nothing."""


def verdict(measurement: Measurement, limits: Limits) -> tuple[str, str]:
    """Return the verdict on a measurement, and what exceeds which limit."""
    pairs = [(name, getattr(measurement, name), getattr(limits, name)) for name in MEASURED]
    broken = [name for name, value, _ in pairs if not np.isfinite(value)]
    if broken:
        return NAN, f"{', '.join(broken)} not finite"
    wrong = [f"{name} {value:.1e} > {limit:.1e}" for name, value, limit in pairs if value > limit]
    return (WRONG, "; ".join(wrong)) if wrong else (RIGHT, "")
