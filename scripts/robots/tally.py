"""The numbers of one case: the time of each step, and measures of the state after it."""

import mujoco
import numpy as np

from .watch import Watch

SETTLED = 100
"""Number of steps after which depths count; overlap of the start has been removed by then."""
SHORT = 1e-6
"""Shortfall relative to the speed below which a step meets its law."""
_SLOWEST = 1e-2  # m/s, smallest speed that a shortfall is divided by
_TINY = 1e-12  # J
_MICRO, _MILLI = 1e6, 1e3


class Tally:
    """Collects steps, evaluates their states between timed blocks, and sums up.

    Attributes:
        bare: processor time of each of MuJoCo's steps, s.
    """

    def __init__(self, steps: int, watch: Watch, data: mujoco.MjData):
        self._watch = watch
        self.bare, self._spent, self._short = (np.full(steps, np.nan) for _ in range(3))
        self._depth, self._limit = np.zeros(steps), np.zeros(steps)
        self._states: list[tuple[int, np.ndarray, np.ndarray]] = []
        self._seen = watch.look(data, data.qpos, data.qvel)
        self._largest = self._seen.energy
        self._scale, self._growth = max(_TINY, abs(self._seen.energy)), 0.0
        self._deepest, self._pair, self._count = 0.0, "", 0

    def add(self, number: int, spent: float, data: mujoco.MjData, before: np.ndarray, shortfall: float) -> None:
        """Record one step; its state is evaluated later, by `look`."""
        self._spent[number] = spent
        self._short[number] = shortfall / max(_SLOWEST, float(np.abs(before).max(initial=0.0)))
        self._states.append((number, data.qpos.copy(), data.qvel.copy()))
        self._count = number + 1

    def look(self, data: mujoco.MjData) -> None:
        """Evaluate the states recorded since the last call."""
        for number, qpos, qvel in self._states:
            seen = self._watch.look(data, qpos, qvel)
            self._depth[number], self._limit[number] = seen.depth, seen.limit
            if number >= SETTLED and seen.depth > self._deepest:
                self._deepest, self._pair = seen.depth, seen.pair
            self._growth = max(self._growth, (seen.energy - self._largest) / self._scale)
            self._largest = max(self._largest, seen.energy)
            self._scale = max(self._scale, abs(seen.energy))
        self._states.clear()

    def row(self, *, bare: bool) -> dict[str, object]:
        """Return the columns of times, depths, energy and shortfall.

        Args:
            bare: whether MuJoCo ran beside, so that times can be compared.
        """
        n = self._count
        row: dict[str, object] = {"steps": n, "start_depth": self._seen.depth, "start_limit": self._seen.limit}
        if n == 0:
            return row
        spent, short = self._spent[:n], self._short[:n]
        mean, late = spent.mean(), slice(SETTLED, n)
        mj = self.bare[:n].mean() if bare else np.nan
        row |= {"mean_us": _MICRO * mean, "mj_us": _MICRO * mj, "ratio": mean / mj}
        row |= {"largest_ms": _MILLI * spent.max(), "over_mean": spent.max() / mean, "largest_at": int(spent.argmax())}
        row |= {"depth": self._depth[late].max(initial=0.0), "depth_between": self._pair}
        row |= {"depth_at": SETTLED + int(self._depth[late].argmax()) if n > SETTLED else -1}
        row |= {"limit": self._limit[late].max(initial=0.0)}
        row |= {"growth": self._growth if self._watch.passive else np.nan}
        if not np.isnan(short).any():  # infinite where contacts were lost
            row |= {"met": float((short < SHORT).mean()), "short": short.max(), "short_at": int(short.argmax())}
        return row
