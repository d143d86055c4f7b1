"""Chains of balls with Hertzian contacts: which impact law a real Newton's cradle obeys."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impactlaw import Collision, Compliant, Moreau
from impactlaw.identification import Collisions, Identified, fit
from impactlaw.identification.measurements import Measurements, rms
from impactlaw.laws import Law, Reversal

UNEQUAL = {3: (1.0, 0.6, 1.4), 4: (1.0, 0.6, 1.4, 0.8), 5: (1.0, 0.6, 1.4, 0.8, 1.2)}
EXPONENTS = (1.0, 1.25, 1.5, 2.0, 3.0)
RATIOS = (1e-4, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4)


def chain(masses: np.ndarray, velocity: np.ndarray) -> Collision:
    """Return a collision of touching balls on a line; gap i lies between balls i and i + 1."""
    n = len(masses)
    labels = tuple(f"{i + 1}/{i + 2}" for i in range(n - 1))
    return Collision(np.diag(masses), np.diff(np.eye(n), axis=0), velocity, labels=labels)


def closing(masses: np.ndarray, n: int, seed: int, law: Law) -> Collisions:
    """Return n collisions with exponentially distributed closing speeds, and their outcomes under the law."""
    rng = np.random.default_rng(seed)
    gamma = -rng.exponential(size=(n, len(masses) - 1))
    collisions = [chain(masses, np.concatenate([[0.0], np.cumsum(g)])) for g in gamma]
    return Collisions(collisions, [law.resolve(c).post_velocity for c in collisions])


@dataclass(frozen=True, eq=False)
class Chain:
    """One chain of balls.

    Attributes:
        balls: number of balls.
        equal: whether their masses are equal.
        launched: v+ after the first ball is launched with velocity 1.
        E: the full matrix that was fitted.
        errors: rms error on held-out collisions, by law.
    """

    balls: int
    equal: bool
    launched: np.ndarray
    E: Identified
    errors: dict[str, float]


def study_chain(masses: np.ndarray, law: Law, *, n: int = 300) -> Chain:
    """Fit E and Newton's coefficients to n collisions, and test them, reversal and Moreau's law on n others."""
    seen, unseen = closing(masses, n, 1, law), closing(masses, n, 2, law)
    measured = Measurements(*unseen)

    def error(candidate: Law) -> float:
        return rms(measured.errors([candidate.resolve(c).post_velocity for c in measured.collisions]))

    found = fit(*seen, "fremond")
    laws = {"full E": found.law, "reversal": Reversal(), "Moreau": Moreau(1.0), "Newton": fit(*seen, "newton").law}
    errors = {name: error(candidate) for name, candidate in laws.items()}
    launched = law.resolve(chain(masses, np.eye(len(masses))[0])).post_velocity
    return Chain(len(masses), bool(np.ptp(masses) == 0), launched, found, errors)


def study_chains(*, n: int = 300) -> list[Chain]:
    """Study Hertzian chains of 3, 4 and 5 equal and unequal balls."""
    law, found = Compliant(1.0), []
    for balls, masses in UNEQUAL.items():
        found += [study_chain(np.ones(balls), law, n=n), study_chain(np.array(masses), law, n=n)]
    return found


def outcomes(laws: Sequence[Law]) -> np.ndarray:
    """Return ``gamma+`` of three equal balls, the first one launched, under each law, (k, 2)."""
    c = chain(np.ones(3), np.array([1.0, 0.0, 0.0]))
    return np.array([law.resolve(c).post_contact_velocity for law in laws])


def paths() -> dict[str, np.ndarray]:
    """Return ``gamma+`` as a function of the exponent and of the stiffness ratio, (k, 2) each."""
    return {
        "exponent": outcomes([Compliant(1.0, exponent=p) for p in EXPONENTS]),
        "stiffness ratio": outcomes([Compliant([1.0, ratio]) for ratio in RATIOS]),
    }


def chains_table(found: list[Chain]) -> str:
    """Return the results as a Markdown table."""
    lines = [
        "| balls | v+, first launched | full E | reversal | Moreau | Newton | certificate |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in found:
        v = ", ".join(f"{x:.4f}" for x in one.launched)
        errors = " | ".join(f"{one.errors[name]:.3f}" for name in ("full E", "reversal", "Moreau", "Newton"))
        kind = "equal" if one.equal else "unequal"
        lines.append(f"| {one.balls} {kind} | ({v}) | {errors} | {one.E.certificate:.4f} |")
    return "\n".join(lines)


def paths_table() -> str:
    """Return the outcome of three balls over exponent and stiffness ratio, as a Markdown table."""
    found = paths()
    lines = ["| changed | value | gamma+ |", "|---|---|---|"]
    for name, values in (("exponent", EXPONENTS), ("stiffness ratio", RATIOS)):
        lines += [f"| {name} | {x:g} | ({a:.4f}, {b:.4f}) |" for x, (a, b) in zip(values, found[name], strict=True)]
    return "\n".join(lines)
