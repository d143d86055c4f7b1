"""The outcomes of collisions as numbers, which compiled code writes for events."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.solvers.cones.algebra.loops import kernel, put
from impactlaw.stepping.compiled.access import data_floats, jacobian_of, number, offset, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, float_at
from impactlaw.stepping.soft.compiled.contacts.equalities import is_kept


class Outcome(NamedTuple):
    """The outcome of a collision, in the order in which compiled code writes it after the number of MuJoCo's rows.

    Rows of a contact are, from its first row in MuJoCo on, the normal and those of its friction, with velocities
    times and impulses divided by their coefficients.
    """

    time: float  # s
    exact: bool  # whether friction is exact Coulomb friction, or else its convex relaxation
    share: float  # least share of restitution that a group of contacts has kept
    qpos: np.ndarray  # (nq,)
    before: np.ndarray  # velocity before the collision, (nv,)
    jump: np.ndarray  # of the velocity, (nv,)
    impulse: np.ndarray  # on each of MuJoCo's rows, (nefc,); NaN if a contact or constraint takes no part
    wanted: np.ndarray  # velocity that the law aims at, for rows of contacts that take part, (nefc,)


def outcomes_in(model: mujoco.MjModel, numbers: np.ndarray) -> list[Outcome]:
    """Return the outcomes that compiled code has written."""
    found, begin = [], 0
    while begin < len(numbers):
        n, time, exact, share = numbers[begin : begin + 4]
        *parts, rest = np.split(numbers[begin + 4 :], np.cumsum([model.nq, model.nv, model.nv, int(n), int(n)]))
        found.append(Outcome(float(time), bool(exact), float(share), *parts))
        begin = len(numbers) - len(rest)
    return found


@kernel
def write_outcome(w, law, found, rows, members, problem, share, calm, x, before, jump):
    """Append the outcome of a collision to `world.Law.outcomes`, if there is room; see `Outcome`.

    Args:
        w: the world.
        law: see `world.Law`.
        found: its contacts.
        rows: rows of contacts that may take part.
        members: those that take part, int64 (k,).
        problem: see `CollisionProblem`, with the restitution that contacts have kept.
        share: see `Outcome`.
        calm: see `equalities.span`.
        x: impulses, (n,).
        before: velocity before the collision, (nv,).
        jump: of the velocity, (nv,).
    """
    n, nq, jacobian = number(w, DATA.nefc), size(w, MODEL.nq), jacobian_of(w, True)
    begin, width = 1 + np.int64(law.outcomes[0]), 4 + nq + 2 * (w.nv + n)
    law.outcomes[0] += width
    if begin + width > len(law.outcomes):
        return
    out, at = law.outcomes[begin : begin + width], 4 + nq + 2 * w.nv
    out[0], out[1], out[2], out[3] = n, float_at(w.data + offset(w, DATA.time)), problem.exact, share
    put(out[4:], data_floats(w, DATA.qpos, nq))
    put(out[4 + nq :], before)
    put(out[4 + nq + w.nv :], jump)
    impulse, wanted = out[at : at + n], out[at + n :]
    impulse[:] = np.nan
    for r in range(number(w, DATA.ne) if len(law.bilateral) > 0 else 0):
        if is_kept(w, law.bilateral, calm, jacobian, r):
            impulse[r] = 0.0
    for g in members:
        for k in range(rows.sizes[g]):
            row, r = found.row[rows.of[g]] + k, rows.first[g] + k
            impulse[row], wanted[row] = x[r], -problem.restored[r]
