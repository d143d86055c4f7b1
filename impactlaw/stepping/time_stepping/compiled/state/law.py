"""Laws in compiled code: a table with one coefficient of restitution for each contact key, and the reversal."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.laws.fremond import Reversal
from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.solvers.cones.algebra.loops import cleared, indices, kernel, zeros
from impactlaw.stepping.compiled import law_table
from impactlaw.stepping.law_targets import LawTargets
from impactlaw.stepping.time_stepping.compiled.state.status import FINE, UNKNOWN
from impactlaw.stepping.time_stepping.problem.drifting_equalities import square_of
from impactlaw.stepping.time_stepping.problem.targets import reached_groups

Array = np.ndarray[Any, Any]


class LawTable(NamedTuple):
    """A law with a coefficient of restitution for each contact."""

    key: Array  # keys of contacts and limits, see `rows.Rows`, ascending, int64 (k,)
    value: Array  # e for each key, (k,)
    asked: Array  # key of a contact that is not in the table, int64 (1,), written


@kernel
def ask_law(law, rows, collides, target):
    """Write the law's targets for colliding contacts, and return `status.FINE`, or `status.UNKNOWN`."""
    for g in range(len(target)):
        if not collides[g]:
            continue
        at = np.searchsorted(law.key, rows.key[g])
        if at == len(law.key) or law.key[at] != rows.key[g]:
            law.asked[0] = rows.key[g]
            return UNKNOWN
        target[g] = -law.value[at] * rows.rates[1, rows.groups[0, g]]
    return FINE


@kernel
def add_reached(rows, tree, collides):
    """Add the closed contacts that a collision reaches to those that collide, bool (g,)."""
    reached = reached_groups(rows, tree, collides, cleared(len(collides)))
    for g in range(len(collides)):
        collides[g] = collides[g] or reached[g]


@kernel
def reverse(e, rows, nv, collides, target):
    """Write the targets of `laws.fremond.Reversal`."""
    order = _in_order(rows, collides)
    h = len(order)
    label, linked = indices(h), cleared(h * h).reshape((h, h))
    _find_blocks(rows, order, zeros(nv), label, linked)
    _put_along_chains(order, label, linked)
    for i in range(h):
        after = 0  # number of later contacts of its block
        for j in range(i + 1, h):
            after += label[j] == label[i]
        for j in range(h):
            if label[j] == label[i]:
                if after == 0:
                    target[order[i]] = -e * rows.rates[1, rows.groups[0, order[j]]]
                    break
                after -= 1


@kernel
def _in_order(rows, chosen):
    """Return the groups of a mask, sorted: contacts by their keys, then limits, int64 (h,)."""
    order, count = np.empty(len(chosen), np.int64), 0
    for g in range(len(chosen)):
        if not chosen[g]:
            continue
        at, limit = count, rows.groups[3, g] < 0
        while at > 0:
            other = order[at - 1]
            behind = rows.groups[3, other] < 0
            if behind < limit or (behind == limit and rows.key[other] <= rows.key[g]):
                break
            order[at] = other
            at -= 1
        order[at] = g
        count += 1
    return order[:count]


@kernel
def _find_blocks(rows, order, row, label, linked):
    """Write which contacts influence each other, to False, (h, h), and a number for each block of such contacts, (h,).

    ``row``, (nv,), must be zero.
    """
    sparse, colind, value, norm = rows.sparse, rows.colind, rows.value, zeros(len(order))
    for i in range(len(order)):
        r = rows.groups[0, order[i]]
        label[i], norm[i] = i, np.sqrt(square_of(rows, r))
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            row[colind[a]] = value[a]
        for j in range(i):
            q, s = rows.groups[0, order[j]], 0.0
            for a in range(sparse[1, q], sparse[1, q] + sparse[0, q]):
                s += value[a] * row[colind[a]]
            linked[i, j] = linked[j, i] = abs(s) > INFLUENCE * norm[i] * norm[j]
            if linked[i, j] and label[i] != label[j]:
                old, new = max(label[i], label[j]), min(label[i], label[j])
                for k in range(i + 1):
                    if label[k] == old:
                        label[k] = new
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            row[colind[a]] = 0.0


@kernel
def _put_along_chains(order, label, linked):
    """Sort the contacts of each block that is a chain along the chain, int64 (h,)."""
    found = order.copy()
    for block in range(len(order)):
        ends, most, now, before = 0, 0, -1, -1
        for i in range(len(order)):
            if label[i] == block:
                degree = np.count_nonzero(linked[i])
                ends, most = ends + (degree == 1), max(most, degree)
                if degree == 1 and now < 0:
                    now = i
        if ends != 2 or most > 2:
            continue
        for i in range(len(order)):
            if label[i] == block:
                order[i], after = found[now], -1
                for k in range(len(order)):
                    if linked[now, k] and k != before:
                        after = k
                before, now = now, after


def reason(targets: LawTargets, model: mujoco.MjModel) -> str | None:
    """Return why compiled code does not cover a law in a scene; None if it does."""
    if isinstance(targets.law, Reversal) and not model.neq:
        return None
    return law_table.reason(targets)
