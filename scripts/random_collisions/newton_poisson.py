"""How often Newton's and Poisson's laws leave S, gain energy and have distant effects, in random collisions.

``python scripts/random_newton_poisson.py`` prints the shares that the README names. A collision has 2 to 4 degrees of
freedom and 2 to 4 contacts, whose gradients, mass matrix and velocity are drawn from normal distributions, and one
coefficient per contact, uniform in [0, 1]. "Some close, others open" keeps those with both kinds of contacts; "all
close" turns every gradient so that its contact closes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import tyro

from impactlaw import Collision, Impact, ImpactLawError, Newton, Poisson

_ROUNDING = 1e-9  # part of |v-| that counts as a violation


@dataclass(frozen=True, kw_only=True)
class Shares:
    """Draw collisions, resolve them by both laws, and print the shares."""

    count: int = 20_000
    """How many of each kind."""
    seed: int = 0
    """Of the first one."""

    def __call__(self) -> None:
        """Print the shares."""
        for kind, closing in (("some close, others open", False), ("all close", True)):
            found = shares(self.count, self.seed, closing=closing)
            for law, (refused, penetrate, gain, distant, most) in found.items():
                print(
                    f"{kind}, {law}: {penetrate:.1%} penetrate, {gain:.1%} gain energy (at most {most:.1e} |v-|), "
                    f"{distant:.1%} have a distant effect, {refused} refused"
                )


def random_collision(rng: np.random.Generator, *, closing: bool) -> Collision:
    """Return a collision of which all contacts close, or some close and others open."""
    while True:
        nv, h = rng.integers(2, 5, 2)
        root, J, v = rng.normal(size=(nv, nv)), rng.normal(size=(h, nv)), rng.normal(size=nv)
        gamma = J @ v
        if closing:
            J = -np.sign(gamma)[:, None] * J
        elif not (gamma.min() < 0 < gamma.max()):
            continue
        return Collision(root @ root.T + 0.1 * np.eye(nv), J, v)


def shares(count: int, seed: int, *, closing: bool) -> dict[str, tuple[int, float, float, float, float]]:
    """Return, by law: collisions refused; shares that penetrate, gain energy, have distant effects; the largest gain.

    The gain is the energetic violation over ``|v-|``. Shares are of the collisions that are not refused.
    """
    rows: dict[str, list[tuple[bool, bool, bool, float]]] = {"Newton": [], "Poisson": []}
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        collision = random_collision(rng, closing=closing)
        e = list(rng.uniform(size=len(collision.labels)))
        for law in (Newton(e), Poisson(e)):
            try:
                rows[type(law).__name__].append(_judged(law.resolve(collision)))
            except ImpactLawError:
                continue
    result = {}
    for law, found in rows.items():
        table = np.array(found, dtype=float)
        penetrate, gain, distant = table[:, :3].mean(axis=0)
        result[law] = count - len(found), penetrate, gain, distant, float(table[:, 3].max())
    return result


def _judged(impact: Impact) -> tuple[bool, bool, bool, float]:
    v, speed = impact.violations, impact.collision.pre_speed
    gain = v.energetic / speed
    return v.kinematic > _ROUNDING * speed, gain > _ROUNDING, impact.has_distant_effect, gain


if __name__ == "__main__":
    tyro.cli(Shares)()
