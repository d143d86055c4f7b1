"""Gaps as functions of the duration of a phase, interpolated through trial steps, and the times when they close."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

_ROOT = 1e-12  # last Newton step to the zero of a cubic, relative to the zero; the steps after it are rounding
_HALVINGS = 60


class Observation(NamedTuple):
    """A contact at the end of a phase."""

    contact: int  # identifies the contact after phases of any duration
    gap: float  # m
    rate: float  # contact velocity, m/s
    before: float  # contact velocity at the start of the phase, m/s


class Node(NamedTuple):
    """A gap, m, after a time, s, and its derivative by that time, m/s."""

    time: float
    gap: float
    slope: float


class GapFunctions:
    """The gaps of contacts that are not held, as functions of the duration of a phase from one start.

    Args:
        gap: gaps of the contacts at the start, m, (h,); the indices identify the contacts. Overlap counts as touching.
        velocity: contact velocities at the start, m/s, (h,).
        exact: whether the velocity at the end of a phase is the derivative of the position by its duration. This is
            true of RK4. The semi-implicit integrators move with the velocity of the end; for them the slope is that of
            the parabola through the nearest gaps.

    Attributes:
        low: longest duration, s, after which no gap was seen to be negative.
    """

    def __init__(self, gap: np.ndarray, velocity: np.ndarray, *, exact: bool):
        self._start, self._exact = (gap, velocity), exact
        self._nodes: dict[int, list[Node]] = {}
        self._deep: dict[float, list[int]] = {}
        self.low = 0.0

    def add(self, time: float, observations: Iterable[Observation]) -> None:
        """Add the observations at the end of a phase of this duration, s."""
        deep = self._deep[time] = []
        for contact, gap, rate, before in observations:
            nodes = self._nodes.get(contact)
            if nodes is None:
                nodes = self._nodes[contact] = self._first(contact, time, gap, rate, before)
            place = bisect_right(nodes, time, key=lambda node: node.time)
            if place and nodes[place - 1].time == time:
                continue  # of two contacts of one pair, keep the first
            slope = rate if self._exact or not nodes else _bent_slope(nodes, time, gap)
            nodes.insert(place, Node(time, gap, slope))
            if gap < 0:
                deep.append(contact)
        if not deep:
            self.low = max(self.low, time)

    def _first(self, contact: int, time: float, gap: float, rate: float, before: float) -> list[Node]:
        """Return the node of a contact at the start.

        A contact that was too far away to be seen there is extrapolated by a parabola; the list is empty if that fails.
        """
        if contact >= 0:
            return [Node(0.0, max(self._start[0].item(contact), 0.0), self._start[1].item(contact))]
        travel = (0.5 * (before + rate) if self._exact else rate) * time
        return [Node(0.0, gap - travel, before)] if gap > travel else []

    def closing(self, low: float, high: float) -> float | None:
        """Return when the first of the gaps that are negative after one phase closed; None if the nodes do not show it.

        Args:
            low: duration, s, after which no gap is negative.
            high: duration of a phase that has been added, s.
        """
        earliest = math.inf
        for contact in self._deep[high]:
            nodes = self._nodes[contact]
            last = bisect_right(nodes, low, key=lambda node: node.time)
            time = _first_zero(nodes[last - 1], nodes[last]) if last else _zero_before(nodes[0])
            if low < time < earliest:
                earliest = time
        return earliest if earliest < high else None


def _bent_slope(nodes: list[Node], time: float, gap: float) -> float:
    """Return the slope at a gap of the parabola through it and the two nearest nodes, or through the only node."""
    one, *others = sorted(nodes, key=lambda node: abs(node.time - time))
    chord = (gap - one.gap) / (time - one.time)
    if not others:
        return 2.0 * chord - one.slope
    other = others[0]
    return chord + (gap - other.gap) / (time - other.time) - (one.gap - other.gap) / (one.time - other.time)


def _zero_before(node: Node) -> float:
    """Return where the tangent at a node becomes negative; infinite if it rises."""
    return node.time - node.gap / node.slope if node.slope < 0.0 else math.inf


def _first_zero(one: Node, other: Node) -> float:
    """Return where the cubic through two nodes first becomes negative between them; infinite if it starts negative."""
    d = other.time - one.time
    rise, zero, first, last = other.gap - one.gap, one.gap, one.slope * d, other.slope * d
    second, third = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    if zero <= 0.0:
        if first <= 0.0:
            return math.inf
        zero, first, second, third = first, second, third, 0.0  # a gap that is zero at the start opens first
    at = [0.0, *_extremes(first, second, third), 1.0]
    for low, high in pairwise(at):
        if zero + high * (first + high * (second + high * third)) < 0.0:
            return one.time + d * _falling_zero(zero, first, second, third, low, high)
    return math.inf


def _extremes(first: float, second: float, third: float) -> list[float]:
    """Return where ``first + 2 second s + 3 third s^2`` is zero between 0 and 1, ascending."""
    square = second * second - 3.0 * first * third
    if square <= 0.0:
        return []
    q = -(second + math.copysign(math.sqrt(square), second))
    zeros = [x / y for x, y in ((q, 3.0 * third), (first, q)) if y != 0.0]
    return sorted(s for s in zeros if 0.0 < s < 1.0)


def _falling_zero(zero: float, first: float, second: float, third: float, low: float, high: float) -> float:
    """Return the zero of a cubic that falls from low to high, by Newton steps in the bracket, or by bisection."""
    s = 0.5 * (low + high)
    for _ in range(_HALVINGS):
        value = zero + s * (first + s * (second + s * third))
        if value > 0.0:
            low = s
        else:
            high = s
        slope = first + s * (2.0 * second + s * 3.0 * third)
        following = s - value / slope if slope < 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - s) <= _ROOT * following:
            return following
        s = following
    return s
