"""Laws with friction on random collisions: does any of them create energy?"""

from collections.abc import Callable

import numpy as np

from impactlaw import Collision, Coulomb, Friction, Impact, ImpactLawError, Poisson, Routh


def random_collision(rng: np.random.Generator, contacts: int, directions: int) -> Collision:
    """Return a collision of independent contacts of a random system; the first one closes, coefficients are up to 2."""
    k = contacts * directions
    nv = contacts + k + int(rng.integers(0, 3))
    A = rng.normal(size=(nv, nv))
    mu = np.repeat(rng.uniform(0.01, 2.0, contacts), directions)
    rows = Friction(rng.normal(size=(k, nv)), np.repeat(np.arange(contacts), directions), mu)
    M = A @ A.T + 0.05 * np.eye(nv)
    J, v = rng.normal(size=(contacts, nv)), rng.normal(size=nv)
    return Collision(M, J, -np.sign(J[0] @ v) * v, friction=rows)


def _routh(hypothesis) -> Callable[[Collision, np.ndarray], Impact]:
    return lambda c, e: Routh(float(e[0]), hypothesis=hypothesis).resolve(c)


CASES: dict[str, tuple[int, int, Callable[[Collision, np.ndarray], Impact]]] = {
    "Routh, Poisson's restitution": (1, 1, _routh("poisson")),
    "Routh, Stronge's restitution": (1, 1, _routh("stronge")),
    "Routh in space": (1, 2, _routh("poisson")),
    "Coulomb(Poisson), one contact": (1, 2, lambda c, e: Coulomb(Poisson(e.tolist())).resolve(c)),
    "Coulomb(Poisson), three contacts": (3, 2, lambda c, e: Coulomb(Poisson(e.tolist())).resolve(c)),
}


def energy_table(count: int) -> str:
    """Return the largest energy gain of each law over `count` random collisions, as a Markdown table."""
    lines = ["| law | collisions | refused | largest (T+ - T-) / T- |", "|---|---|---|---|"]
    for name, (contacts, directions, resolve) in CASES.items():
        worst, refused = -np.inf, 0
        for seed in range(count):
            rng = np.random.default_rng([len(name), seed])
            c = random_collision(rng, contacts, directions)
            e = np.ones(contacts) if seed % 2 else rng.uniform(size=contacts)
            try:
                impact = resolve(c, e)
            except ImpactLawError:
                refused += 1
                continue
            worst = max(worst, impact.energy_change / c.kinetic_energy)
        lines.append(f"| {name} | {count} | {refused} | {worst:.1e} |")
    return "\n".join(lines)
