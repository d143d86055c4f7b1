"""Time of a law from (Y, v-) to v+, certificate included, against one bare call of `scipy.optimize.nnls`.

The whitened Jacobian Y and the whitened velocity R^T v- are given; the time "law" includes everything else: lengths of
the gradients, contact velocities, the target, the certificate. Bare NNLS gets the same Y and a d with ``Y d = c``,
prepared outside its time, and its answer is not checked.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np
from scipy.optimize import nnls

from impactlaw import Collision, Fremond, Impact, Law, Moreau, Newton
from impactlaw.solvers import Problem

from .timing import Row, in_turns

_MANY = 320  # total number of contacts of the problems of a row
_SLOW = 0.2  # s; above this time of a round, two rounds are enough
_KINDS = ("independent", "plate")


def run(
    sizes: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64, 128, 256), *, problems: int = 20, seconds: float = 0.25
) -> Iterator[Row]:
    """Yield one row per kind of contacts, h and law.

    Columns: nnls_us; law_us (`Law.resolve`) and audited_us (with `Impact.residual` as well, which is independent of
    the solver), each with its ratio to nnls; residual, the largest over the problems.

    Args:
        sizes: numbers of contacts h.
        problems: random problems of each size and kind, fewer where they are large; a round solves each one once.
        seconds: time per row.
    """
    for kind, h in product(_KINDS, sizes):
        several = list(collisions(kind, h, min(problems, max(2, _MANY // h))))
        for name, law in laws(kind, h).items():
            yield {"kind": kind, "h": h, "law": name} | _row(law, several, seconds)


def collisions(kind: str, h: int, count: int, seed: int = 0) -> Iterator[Collision]:
    """Yield random collisions: "independent" closing contacts (3 h / 2 degrees of freedom), or feet of a free plate."""
    rng = np.random.default_rng([seed, h, _KINDS.index(kind)])
    for _ in range(count):
        if kind == "plate":
            foot = rng.uniform(-1.0, 1.0, (2, h))
            J = np.column_stack([np.zeros((h, 2)), np.ones(h), foot[1], -foot[0], np.zeros(h)])
            velocity = np.concatenate([[0.3, 0.0, -1.0], rng.uniform(-0.4, 0.4, 3)])
            yield Collision(np.diag([2.0] * 3 + [0.7, 0.7, 1.3]), J, velocity)
            continue
        nv = (3 * h + 1) // 2
        A, J = rng.normal(size=(nv, nv)), rng.normal(size=(h, nv))
        closing = rng.uniform(0.5, 1.5, h)
        yield Collision(A @ A.T / nv + 0.1 * np.eye(nv), J, -np.linalg.lstsq(J, closing, rcond=None)[0])


def laws(kind: str, h: int) -> dict[str, Law]:
    """Return the laws to time; for a plate, only the law that has a solution for redundant contacts."""
    if kind == "plate":
        return {"moreau 0.5": Moreau(0.5)}
    matrix = 0.4 * np.eye(h) + 0.4 * np.eye(h)[::-1]
    return {"moreau 0.5": Moreau(0.5), "newton": Newton(np.linspace(0.2, 0.9, h).tolist()), "fremond": Fremond(matrix)}


def _row(law: Law, several: list[Collision], seconds: float) -> Row:
    problems = [problem(law, c) for c in several]
    start = time.perf_counter()
    residual = max(law.resolve(c).residual for c in several)
    rounds = 2 if time.perf_counter() - start > _SLOW else 5
    subjects: dict[str, Callable[[], list[Callable[[], object]]]] = {
        "nnls": lambda: [partial(nnls, p.gradients.T, p.preimage) for p in problems],
        "law": lambda: [partial(law.resolve, fresh(c)) for c in several],
        "audited": lambda: [partial(_resolve_and_audit, law, fresh(c)) for c in several],
    }
    timed = in_turns(subjects, seconds=seconds, fewest=rounds)
    row: Row = {"residual": residual}
    row |= {f"{name}_us": timed.microseconds(name) for name in subjects}
    return row | {f"{name}_ratio": timed.ratio(name, "nnls") for name in ("law", "audited")}


def _resolve_and_audit(law: Law, collision: Collision) -> tuple[Impact, float]:
    impact = law.resolve(collision)
    return impact, impact.residual


def fresh(collision: Collision) -> Collision:
    """Return a copy that knows M, J, v-, Y and R^T v-, but has derived no other quantity from them yet."""
    c = collision
    known = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, labels=c.labels, metric=c.metric)
    known.__dict__.update(whitened_jacobian=c.whitened_jacobian, whitened_velocity=c.whitened_velocity)
    return known


def problem(law: Law, collision: Collision) -> Problem:
    """Return the law's problem; its d, for bare NNLS, is the law's own or solves ``Y d = c`` by least squares."""
    wanted, _, coefficient = law.target(collision)
    c, Y = wanted - collision.pre_contact_velocity, collision.whitened_jacobian
    common = coefficient is not None
    d = -(1.0 + coefficient) * collision.whitened_velocity if common else np.linalg.lstsq(Y, c, rcond=None)[0]
    return Problem(Y, c, d, collision.pre_speed, norms=collision.gradient_norms)
