"""Distance of computed states from the graph of a reference trajectory, in (t, q) or, with jumps filled, in (t, q, v).

The velocity of a trajectory with impacts jumps. If an approximation jumps a little later, the two velocities differ by
the whole jump for a short time, so that the largest difference at equal times is an error of order one, however close
the two trajectories are. The completed graph

    graph = {(t, q(t), v(t))} joined at every impact by the segment from (t, q, v-) to (t, q, v+)

is one continuous curve, and the distance of a computed state (t_i, q_i, v_i) from it,

    d_i = min over (s, q, v) in graph of |((t_i - s) / T, (q_i - q) / Q, (v_i - v) / V)|,

measures a late bounce by its delay. T is the duration, Q and V are the largest ranges of any coordinate and of any
velocity of the reference, so that d has no unit. The error of a trajectory is the largest d_i over its states: the
directed Hausdorff distance from the states to the graph. The other direction would add the motion between two states,
which depends on the chosen resolution and is not an error.

Without velocities, d_i = min over s of |((t_i - s) / T, (q_i - q(s)) / Q)|, the distance from the graph of the
positions. It ignores the velocities during a short collision of several contacts: soft contacts, and time stepping that
resolves such a collision over several steps, leave the segment from v- to v+.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

_SAMPLES = 4000  # number of samples on all smooth pieces together, to find the nearest piece and time
_FEWEST = 24  # smallest number of samples on one piece
_NEAR = 2  # number of pieces before and after the one with the nearest sample that are searched, too
_ITERATIONS = 8  # Gauss-Newton iterations for the time of the nearest point, with the slope at the first guess


@dataclass(frozen=True, eq=False)
class Arc:
    """A smooth piece of a trajectory.

    Attributes:
        begin: start time, s.
        end: end time, s.
        state: maps times, (n,), to positions and velocities side by side, (n, 2 nv); defined a little beyond both ends.
    """

    begin: float
    end: float
    state: Callable[[np.ndarray], np.ndarray]

    def points(self, times: np.ndarray) -> np.ndarray:
        """Return the points (t, q, v) at these times, (n, 1 + 2 nv)."""
        return np.column_stack([times, self.state(times)])


class CompletedGraph:
    """The graph of a trajectory of smooth pieces, each joined to the next by a segment.

    Args:
        arcs: the pieces in the order of time.
        velocities: whether distances are in (t, q, v), or in (t, q).

    Attributes:
        scale: divisors of t, of each q and, with velocities, of each v.
    """

    def __init__(self, arcs: Sequence[Arc], *, velocities: bool = True):
        self.arcs = tuple(arcs)
        duration = self.arcs[-1].end - self.arcs[0].begin
        times = [_grid(arc, duration) for arc in self.arcs]
        sampled = [arc.points(t) for arc, t in zip(self.arcs, times, strict=True)]
        scale = _scale(np.vstack(sampled))
        self.scale = scale if velocities else scale[: 1 + len(scale) // 2]
        self._times = np.concatenate(times)
        self._piece = np.repeat(np.arange(len(times)), [len(t) for t in times])
        self._tree = KDTree(self._scaled(np.vstack(sampled)))
        self._jumps = [(self._scaled(a[-1:])[0], self._scaled(b[:1])[0]) for a, b in pairwise(sampled)]

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        return points[:, : len(self.scale)] / self.scale

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the scaled distance of every point (t, q, v) from the graph, (n,)."""
        p = self._scaled(points)
        _, nearest = self._tree.query(p)
        piece, time = self._piece[nearest], self._times[nearest]
        best = np.full(len(p), np.inf)
        for k, arc in enumerate(self.arcs):
            close = np.flatnonzero(np.abs(piece - k) <= _NEAR)
            if len(close):
                guess = np.where(piece[close] == k, time[close], np.clip(points[close, 0], arc.begin, arc.end))
                best[close] = np.minimum(best[close], self._to_arc(p[close], arc, guess))
        for before, after in self._jumps:
            best = np.minimum(best, _to_segment(p, before, after))
        return best

    def _to_arc(self, p: np.ndarray, arc: Arc, guess: np.ndarray) -> np.ndarray:
        """Return the distance from the nearest point of a smooth piece, by Gauss-Newton iterations for its time."""
        span = arc.end - arc.begin
        if span <= 0:
            return np.linalg.norm(p - self._scaled(arc.points(np.array([arc.begin]))), axis=1)
        s, small = guess, 1e-5 * span
        slope = (self._scaled(arc.points(s + small)) - self._scaled(arc.points(s - small))) / (2 * small)
        best = np.full(len(p), np.inf)
        for _ in range(_ITERATIONS):
            apart = p - self._scaled(arc.points(s))
            best = np.minimum(best, np.linalg.norm(apart, axis=1))
            s = np.clip(s + np.vecdot(apart, slope) / np.vecdot(slope, slope), arc.begin, arc.end)
        return best


def _grid(arc: Arc, duration: float) -> np.ndarray:
    span = arc.end - arc.begin
    if span <= 0:
        return np.array([arc.begin])
    return np.linspace(arc.begin, arc.end, max(_FEWEST, int(_SAMPLES * span / duration)))


def _scale(points: np.ndarray) -> np.ndarray:
    nv = points.shape[1] // 2
    spread = np.ptp(points, axis=0)
    q, v = spread[1 : 1 + nv].max(), spread[1 + nv :].max()
    return np.concatenate([[spread[0]], np.full(nv, q), np.full(nv, v)])


def _to_segment(p: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    along = after - before
    length = along @ along
    part = np.clip((p - before) @ along / length, 0.0, 1.0)[:, None] if length > 0 else 0.0
    return np.linalg.norm(p - before - part * along, axis=1)
