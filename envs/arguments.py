"""Check arguments of this package's environments, and make their spaces."""

from __future__ import annotations

import numbers
from collections.abc import Iterable, Sequence

import numpy as np
from gymnasium.spaces import Box

from impactlaw.envs.rendering import has_display
from impactlaw.errors import RenderError, SceneError, UnknownNameError


def check_arguments(frame_skip: object, render_mode: str | None, known: Iterable[str]) -> None:
    """Check the number of timesteps per step, and the render mode.

    Raises:
        SceneError: frame_skip is not a positive integer.
        UnknownNameError: there is no such render mode.
        RenderError: there is no display to draw on.
    """
    if not isinstance(frame_skip, numbers.Integral) or frame_skip < 1:
        raise SceneError(f"frame_skip is a whole number of timesteps, 1 or more, got {frame_skip!r}")
    if render_mode not in (None, *known):
        raise UnknownNameError("render mode", render_mode, known)
    if render_mode == "human" and not has_display():
        raise RenderError('there is no display for render_mode="human"; use "rgb_array", or log="run.rrd"')


def box(groups: Sequence[tuple[int, float, float]]) -> Box:
    """Return a box space of groups of numbers, each given by its length, lower bound and upper bound."""
    low = np.concatenate([np.full(count, low) for count, low, _ in groups])
    high = np.concatenate([np.full(count, high) for count, _, high in groups])
    return Box(low, high, dtype=np.float64)
