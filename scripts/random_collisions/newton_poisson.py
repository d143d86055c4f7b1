"""How often Newton's and Poisson's laws leave S, gain energy and have distant effects, in random collisions.

A collision has 2 to 4 degrees of freedom and 2 to 4 contacts. Gradients, mass matrix and velocity are drawn from normal
distributions, and one coefficient of restitution per contact uniformly from [0, 1]. "Some close, others open" keeps the
collisions with both kinds of contacts; "all close" flips gradients so that every contact closes.
"""

from contextlib import suppress

import numpy as np
import pandas as pd
import tyro

from impactlaw import Collision, ImpactLawError, Newton, Poisson
from scripts.options import Count

_ROUNDING = 1e-9  # part of |v-| above which an error counts as a violation


def random_collision(rng: np.random.Generator, *, closing: bool) -> Collision:
    """Return a random collision in which all contacts close, or some close and others open."""
    while True:
        nv, h = rng.integers(2, 5, 2)
        root, J, v = rng.normal(size=(nv, nv)), rng.normal(size=(h, nv)), rng.normal(size=nv)
        gamma = J @ v
        if closing:
            J = -np.sign(gamma)[:, None] * J
        elif not (gamma.min() < 0 < gamma.max()):
            continue
        return Collision(root @ root.T + 0.1 * np.eye(nv), J, v)


def shares(count: int, *, closing: bool) -> pd.DataFrame:
    """Return one row per law.

    Columns: refused, the share of collisions that the law refuses; of the others, the shares that end with penetration,
    with a gain of energy and with distant effects; largest_gain, the largest energetic violation over |v-|.
    """
    rows = []
    for k in range(count):
        rng = np.random.default_rng([0, k])
        collision = random_collision(rng, closing=closing)
        e = list(rng.uniform(size=len(collision.labels)))
        for law in (Newton(e), Poisson(e)):
            row: dict[str, object] = {"law": type(law).__name__, "refused": True}
            with suppress(ImpactLawError):
                impact = law.resolve(collision)
                found, speed = impact.violations, collision.pre_speed
                row |= {"refused": False, "penetrates": float(found.kinematic / speed > _ROUNDING)}
                row |= {"gains": float(found.energetic / speed > _ROUNDING), "largest_gain": found.energetic / speed}
                row |= {"distant": float(impact.has_distant_effect)}
            rows.append(row)
    told = dict.fromkeys(("refused", "penetrates", "gains", "distant"), "mean")
    return pd.DataFrame(rows).groupby("law").agg({**told, "largest_gain": "max"})


def main(count: Count = 20_000) -> None:
    """Draw collisions, resolve them by both laws, and print the shares.

    Args:
        count: number of collisions of each kind.
    """
    for kind, closing in (("some close, others open", False), ("all close", True)):
        table = shares(count, closing=closing)
        print(f"{kind}\n{table.to_string(float_format=lambda x: f'{x:.2g}')}\n")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
