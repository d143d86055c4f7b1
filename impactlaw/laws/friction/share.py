"""The search for the share s of restitution that creates no energy. Compiled soft steps use `next_share`."""

from __future__ import annotations

from math import isnan, sqrt

CREATED = 1e-12
"""Energy created, relative to the energy before, up to which it is rounding."""
SEARCHES = 60
"""Most shares that are tried."""
FOUND, SOLVABLE = 1e-10, 0.03
"""Width of the bracket of s at which the search ends; the second where no impact was found at its upper end."""
AIM = 5e-12
"""Relative loss of energy that the search aims at, so that its result is on the side that creates none."""


def next_share(
    low: float, high: float, third: float, below: float, above: float, beyond: float, stalled: bool
) -> float:
    """Return the share to try next: the root of a parabola through known points, or the middle of the bracket.

    The energy created is quadratic in s as long as the same contacts stick, slide and separate. Without friction it has
    no linear term, so the parabola through two points has its vertex at the lower one, s = 0.

    Args:
        low: lower end of the bracket.
        high: upper end of the bracket.
        third: the end that was replaced last; NaN if none was.
        below: energy created at low; it must be negative to be of use.
        above: energy created at high, positive; infinite if no impact was found there.
        beyond: energy created at the third point.
        stalled: whether the last try reduced the error too little; the result is then the middle.
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
