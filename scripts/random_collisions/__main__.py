"""Random collisions with friction and joint limits: is any energy created, and is every answer certified?

Rigid bodies touch each other and the ground, stand flat on four corners, or are held between opposing contacts. Unit
rows of the Jacobian are limits, without friction. Laws, normal and tangential restitution, both friction cones,
coefficients of friction from 0.01 to 2 and mass ratios up to 1e6 are also drawn at random.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import joblib
import numpy as np
import pandas as pd
from tqdm import tqdm

from impactlaw import Collision, Coulomb, Fremond, Friction, FrictionImpact, ImpactLawError, Law, MaximalDissipation
from impactlaw.laws import Moreau, Newton
from scripts import machine
from scripts.options import Count, Jobs, Seed, read

TOLERANCE = 1e-9
"""Largest allowed residual, and largest allowed violations of energy and of the friction cones relative to |v-|."""


@dataclass(frozen=True, kw_only=True)
class RandomCollisions:
    """How many collisions to draw, and how large."""

    count: Count = 100_000
    """Number of collisions."""
    contacts: Count = 8
    """Largest number of contacts of a collision, without limits."""
    seed: Seed = 0
    """Collision k is drawn with the seed (seed, k)."""
    processes: Jobs = 1
    """Number of processes; -1 for one per processor."""
    quick: bool = False
    """Draw 300 collisions only."""
    out: Path = Path("out/random_collisions")
    """Folder for random_collisions.csv."""


def run(study: RandomCollisions) -> pd.DataFrame:
    """Return one row per collision, and show a progress bar if there is a terminal.

    Columns: k, contacts (limits included), rows (of the cone problem), law, cone, restitution_scale, residual,
    energetic and kinetic (violations relative to |v-|), seconds, and error, the message of a refusal.
    """
    count = 300 if study.quick else study.count
    rows = joblib.Parallel(study.processes, return_as="generator")(
        joblib.delayed(row_of)(study, k) for k in range(count)
    )
    return pd.DataFrame(tqdm(rows, total=count, disable=None, unit="collision"))


def row_of(study: RandomCollisions, k: int) -> dict[str, object]:
    """Draw collision k, resolve it, and return its row."""
    rng = np.random.default_rng([study.seed, k])
    collision = random_collision(rng, study.contacts)
    law = random_law(rng, collision)
    size = len(collision.labels) + (0 if collision.friction is None else len(collision.friction))
    row: dict[str, object] = {"k": k, "contacts": len(collision.labels), "rows": size}
    row |= {"law": type(law.law).__name__, "cone": law.cone, "error": ""}
    began = time.perf_counter()
    try:
        impact = law.resolve(collision)
    except ImpactLawError as error:
        return row | {"seconds": time.perf_counter() - began, "error": f"{type(error).__name__}: {error}"}
    row["seconds"] = time.perf_counter() - began
    violations, speed = impact.violations, collision.pre_speed
    row |= {"residual": impact.residual, "energetic": violations.energetic / speed}
    row |= {"kinetic": violations.kinetic / speed}
    return row | {"restitution_scale": impact.restitution_scale if isinstance(impact, FrictionImpact) else 1.0}


def random_law(rng: np.random.Generator, collision: Collision) -> Coulomb:
    """Return Coulomb friction with a random law for the normals."""
    e, h = rng.uniform(), len(collision.labels)
    kinds: tuple[Callable[[], Law], ...] = (
        MaximalDissipation,
        lambda: Moreau(float(e)),
        lambda: Moreau(1.0),
        lambda: Newton(list(rng.uniform(size=h))),
        lambda: Fremond(rng.normal(size=(h, h)) / h),
    )
    inner = kinds[rng.integers(5)]()
    along = float(rng.choice([0.0, rng.uniform(), 1.0]))
    return Coulomb(inner, tangential_restitution=along, cone="exact" if rng.random() < 0.7 else "convex")


def random_collision(rng: np.random.Generator, most: int) -> Collision:
    """Return a random collision of rigid bodies in contact, with 1 to ``most`` contacts and some limits."""
    h = int(rng.integers(1, most + 1))
    bodies = int(rng.integers(1, h // 2 + 2))
    size = rng.uniform(0.2, 1.0, bodies)
    mass = 10.0 ** rng.uniform(-3.0, 3.0, bodies) if rng.random() < 0.3 else rng.uniform(0.5, 2.0, bodies)
    flat = rng.random() < 0.4
    normals, tangents, contact, mu = [], [], [], []
    for k in range(h):
        block, coefficients = _contact(rng, size, flat, k)
        normals.append(block[0])
        tangents += list(block[1 : len(coefficients) + 1])
        contact += [k] * len(coefficients)
        mu += list(coefficients)
    nv = 6 * bodies
    limits = np.eye(nv)[rng.choice(nv, int(rng.integers(0, 3)), replace=False)] * rng.choice([-1.0, 1.0])
    J = np.vstack([np.array(normals), limits])
    M = np.diag(
        np.concatenate([[m] * 3 + list(m * s**2 * rng.uniform(0.1, 0.5, 3)) for m, s in zip(mass, size, strict=True)])
    )
    friction = Friction(np.array(tangents), np.array(contact), np.array(mu))
    return Collision(M, J, _velocity(rng, J), friction=friction)


def _contact(rng: np.random.Generator, size: np.ndarray, flat: bool, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of a contact (normal, two tangential, torsional, two rolling) and its 0 to 5 coefficients."""
    i, j = int(rng.integers(len(size))), int(rng.integers(-1, len(size)))
    normal = np.array([0.0, 0.0, 1.0]) if flat else rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    frame = np.array([normal, across, np.cross(normal, across)])
    corner = np.array([2.0 * (k % 2) - 1.0, 2.0 * (k // 2 % 2) - 1.0, -1.0])
    block = np.zeros((6, 6 * len(size)))
    for body, sign in ((i, 1.0), (j if j != i else -1, -1.0)):
        if body < 0:
            continue
        arm = size[body] * (corner * [1, 1, sign] if flat else -sign * normal + 0.2 * rng.normal(size=3))
        at = 6 * body
        block[:3, at : at + 3] += sign * frame
        block[:3, at + 3 : at + 6] += sign * np.cross(arm, frame)
        block[3:, at + 3 : at + 6] += sign * frame
    d = int(rng.choice([0, 2, 3, 5], p=[0.1, 0.6, 0.15, 0.15])) if k else 2
    first = 10.0 ** rng.uniform(-2.0, 0.3)
    return block, np.array([first, first * rng.uniform(0.5, 1.0), 0.1 * first, 0.03 * first, 0.03 * first])[:d]


def _velocity(rng: np.random.Generator, J: np.ndarray) -> np.ndarray:
    """Return, mostly, a velocity at which all contacts close if there is one; otherwise a random velocity."""
    v = rng.normal(size=J.shape[1])
    if rng.random() < 0.7:
        lengths = np.linalg.norm(J, axis=1)
        v = 0.5 * v - np.linalg.lstsq(J, J @ v * 0.5 + np.abs(rng.normal(size=len(J))) * lengths, rcond=None)[0]
    return v


def format_table(table: pd.DataFrame) -> str:
    """Return the worst errors of each law and cone, and the numbers of refused and of scaled collisions."""
    told = table.assign(refused=table.error != "", scaled=table.restitution_scale < 1, ms=1e3 * table.seconds)
    worst = dict.fromkeys(("residual", "energetic", "kinetic"), "max")
    groups = told.groupby(["law", "cone"]).agg(
        {"k": "size", "refused": "sum", "scaled": "sum", **worst, "ms": "median"}
    )
    return groups.rename(columns={"k": "number"}).to_string(float_format=lambda x: f"{x:.2g}")


def failed(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of collisions that are refused or exceed the tolerance."""
    beyond = table[["residual", "energetic", "kinetic"]].max(axis=1) > TOLERANCE
    return table.loc[beyond | (table.error != "")]


def main(study: RandomCollisions) -> None:
    """Run the study, print the worst errors of each law and cone, and write every row as CSV."""
    table = run(study)
    machine.write({"random_collisions": table}, study.out)
    print(format_table(table))
    broken = failed(table)
    refused, wrong = broken[broken.error != ""], broken[broken.error == ""]
    print(f"\n{len(table)} collisions: {len(refused)} refused, {len(wrong)} beyond {TOLERANCE:g}")
    print(f"largest energetic violation {table.energetic.max():.2e} of |v-|; {machine.one_line()}")
    sys.exit(1 if len(wrong) else 0)


if __name__ == "__main__":
    main(read(RandomCollisions, __doc__))
