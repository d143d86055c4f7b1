"""The share of restitution to try next, where the whole creates energy; compiled steps take it over."""

from __future__ import annotations

from math import isnan, sqrt

CREATED = 1e-12
"""Energy, relative to the one before, up to which its creation is rounding."""
SEARCHES = 60
"""Shares that are tried."""
FOUND, SOLVABLE = 1e-10, 0.03
"""Widths of the bracket of s that are narrow enough, the second where beyond the bracket no impact was found."""
AIM = 5e-12
"""Energy lost, relative to the one before, that a search aims at: what it finds is then on the right side."""


def next_share(
    low: float, high: float, third: float, below: float, above: float, beyond: float, stalled: bool
) -> float:
    """Return where the parabola through three points is 0, or through two, or the middle.

    The energy that is created is quadratic in s while the same contacts stick, slide and separate, and without friction
    no other terms than its square have a part in it: of two points, that at 0 is the vertex.

    Args:
        low: lower end of the bracket.
        high: upper end.
        third: the end that was replaced last; NaN if none was.
        below: value there, negative; else it is of no use.
        above: value at the upper end, positive; infinite if there is none.
        beyond: value at the third point.
        stalled: whether the last try was of little use.
    """
    width = high - low
    if stalled or not below < 0.0 or not above < 1e300:
        return low + 0.5 * width
    if isnan(third):
        s = low + width * sqrt(-below / (above - below))
    else:
        slope, bend = (above - below) / width, 0.0
        if beyond < 1e300:
            bend = ((beyond - above) / (third - high) - slope) / (third - low)
        start = slope - bend * width
        s = low - 2.0 * below / (start + sqrt(max(start * start - 4.0 * bend * below, 0.0)))
    return s if low < s < high else low + 0.5 * width
