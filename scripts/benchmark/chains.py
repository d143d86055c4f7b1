"""Chains of balls: the law on sparse data against OSQP and Clarabel, which get the same data as a quadratic program.

The program is ``min Lambda^T G Lambda / 2 - c^T Lambda, Lambda >= 0`` ("impulse") or ``min |z|^2 / 2, Y z >= c``
("velocity"); the goals compare with the faster form of each solver. All times include the solver's setup or the law's
own preparations, but not the forming of G and of the programs' matrices. Residuals are measured in the same way for
all, by the natural map of the law's complementarity.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from impactlaw import Collision, Impact, Moreau

from .laws import fresh
from .timing import Row, in_turns

TOLERANCE = 1e-9
"""Tolerance that OSQP and Clarabel are asked for."""
STARTS = ("launched", "random")
_RESTITUTION = 0.5
_ITERATIONS = 20_000  # of OSQP
_LONG = 1.0  # s; if one call of each solver takes longer, at least two rounds are timed, otherwise at least five


class Program(NamedTuple):
    """The quadratic program ``min x^T P x / 2 + q^T x, A x >= low``; P (its upper triangle) and A are CSC matrices."""

    P: sp.csc_matrix
    q: np.ndarray
    A: sp.csc_matrix
    low: np.ndarray


@dataclass(frozen=True)
class Chain:
    """One problem, as the law gets it and as quadratic programs.

    Attributes:
        collision: the collision, with sparse M and J.
        Y: whitened Jacobian, CSR, (h, nv).
        c: change of the contact velocities that the law asks for, (h,).
        lengths: lengths of the rows of Y, (h,).
        speed: ``|v-|``, sqrt(J).
        programs: the quadratic programs, by form.
    """

    collision: Collision
    Y: sp.csr_array
    c: np.ndarray
    lengths: np.ndarray
    speed: float
    programs: dict[str, Program]

    def residual(self, impulse: np.ndarray) -> float:
        """Return ``|min(Lambda_i |Y_i|, (Y z - c)_i / |Y_i|)|`` with ``z = Y^T Lambda``, relative to ``|v-|``."""
        slack = (self.Y @ (self.Y.T @ impulse) - self.c) / self.lengths
        return float(np.linalg.norm(np.minimum(impulse * self.lengths, slack))) / self.speed


def chain(h: int, start: str, seed: int = 0) -> Chain:
    """Return the problem of h contacts between h + 1 balls on a line.

    They are equal and in touch, and the first one comes in ("launched"), or their masses and velocities are random
    ("random"), so that some of the contacts separate.
    """
    rng = np.random.default_rng([seed, h])
    n = h + 1
    mass, v = np.ones(n), np.zeros(n)
    v[0] = 1.0
    if start == "random":
        mass, v = rng.uniform(0.5, 2.0, n), rng.normal(size=n)
    J = sp.csr_array(sp.eye_array(h, n, k=1) - sp.eye_array(h, n))
    Y = sp.csr_array(J @ sp.diags_array(1.0 / np.sqrt(mass)))
    collision = Collision(sp.csr_array(sp.diags_array(mass)), J, v)  # pyright: ignore[reportArgumentType]
    lengths = np.sqrt(np.asarray((Y * Y).sum(axis=1)).ravel())
    c = -(1.0 + _RESTITUTION) * np.diff(v)
    programs = {
        "impulse": Program(sp.csc_matrix(sp.triu(Y @ Y.T)), -c, sp.csc_matrix(sp.eye_array(h)), np.zeros(h)),
        "velocity": Program(sp.csc_matrix(sp.eye_array(n)), np.zeros(n), sp.csc_matrix(Y), c),
    }
    return Chain(collision, Y, c, lengths, float(np.sqrt(mass @ v**2)), programs)


def run(sizes: tuple[int, ...] = (100, 1000, 10_000), *, seconds: float = 3.0) -> Iterator[Row]:
    """Yield one row per chain and solver.

    Columns: milliseconds (median), residual of the impulse (measured alike for all solvers), ratio of the time to the
    law's; outcome, "solved" or the reason why the solver failed.

    Args:
        sizes: numbers of contacts.
        seconds: time per chain.
    """
    for start, h in product(STARTS, sizes):
        yield from ({"chain": start, "h": h} | row for row in _rows(chain(h, start), seconds))


def _rows(problem: Chain, seconds: float) -> Iterator[Row]:
    solvers: dict[str, Callable[[], np.ndarray | str]] = {"law": lambda: _law(problem).impulse}
    for form, program in problem.programs.items():
        solvers[f"osqp, {form}"] = partial(_osqp, program, form)
        solvers[f"clarabel, {form}"] = partial(_clarabel, program, form)
    begin = time.perf_counter()
    answers = {name: solve() for name, solve in solvers.items()}
    fewest = 2 if time.perf_counter() - begin > _LONG else 5
    calls: dict[str, Callable[[], object]] = {**solvers, "law": partial(_law, problem)}
    solved = [name for name, answer in answers.items() if not isinstance(answer, str)]
    timed = in_turns({name: lambda name=name: [calls[name]] for name in solved}, seconds=seconds, fewest=fewest)
    for name, answer in answers.items():
        if isinstance(answer, str):
            yield {"solver": name, "outcome": answer}
            continue
        row: Row = {"milliseconds": timed.microseconds(name) / 1e3, "ratio": timed.ratio(name, "law")}
        yield {"solver": name, "outcome": "solved"} | row | {"residual": problem.residual(answer)}


def _law(problem: Chain) -> Impact:
    """Resolve a collision whose M, J, v-, Y and R^T v- are known, and certify the result."""
    return Moreau(_RESTITUTION).resolve(fresh(problem.collision))


def _osqp(program: Program, form: str) -> np.ndarray | str:
    import osqp

    solver = osqp.OSQP()
    limits = {"l": program.low, "u": np.full(len(program.low), np.inf)}
    options = {"eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "max_iter": _ITERATIONS, "verbose": False}
    solver.setup(P=program.P, q=program.q, A=program.A, **limits, **options)
    result = solver.solve(raise_error=False)
    if result.info.status != "solved":
        return f"{result.info.status} after {result.info.iter} iterations"
    return np.maximum(result.x if form == "impulse" else -result.y, 0.0)


def _clarabel(program: Program, form: str) -> np.ndarray | str:
    if find_spec("clarabel") is None:  # not a dependency; compared where it is installed
        return "not installed"
    clarabel = import_module("clarabel")
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    cones = [clarabel.NonnegativeConeT(len(program.low))]
    result = clarabel.DefaultSolver(program.P, program.q, -program.A, -program.low, cones, settings).solve()
    if str(result.status) != "Solved":
        return str(result.status)
    return np.maximum(np.array(result.x if form == "impulse" else result.z), 0.0)
