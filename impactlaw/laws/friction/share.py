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

    The bracket is from low, with a value below 0, else of no use, to high, with one above 0, infinite if there is none.
    The third point, with the value beyond, is the end that was replaced last, NaN if none was. It is the middle where
    the last try was of little use: stalled.
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
