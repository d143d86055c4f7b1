"""An audit of measured collisions: which physics they violate, and which single change would repair it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import SolverError
from impactlaw.identification.families import largest_friction, with_friction
from impactlaw.identification.measurements import Measurements
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact

TOLERANCE = 0.1
"""Violation, relative to |v-|, up to which a measured collision counts as admissible."""
_BETTER = 0.8  # share of collisions that a likely cause must improve
_HALF = 0.5  # largest part of the median violation that may remain under a likely cause
_NOTHING = 1e-9  # violation that is rounding
_SAMPLE = 200  # collisions on which friction and inertias are tried
_MOST_FREEDOMS = 12  # most degrees of freedom for which signs and inertias are tried, one by one
_FRICTIONS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5)
_RATIOS = np.geomspace(0.05, 20.0, 31)


@dataclass(frozen=True)
class Cause:
    """A possible cause of violations: one change of the measurements, and its effect.

    Attributes:
        name: name of the change.
        value: the value fitted for it, a ratio or a coefficient; nan for a sign.
        better: share of collisions whose violation the change reduces, among those with a violation before or after.
        better_of_bad: the same among collisions whose violation exceeds `TOLERANCE` before; nan if there are none.
        before: median violation without the change, relative to ``|v-|``.
        after: median violation with the change.
    """

    name: str
    value: float
    better: float
    better_of_bad: float
    before: float
    after: float

    @property
    def is_likely(self) -> bool:
        """Whether the change improves most collisions and removes most of the violation."""
        return self.better >= _BETTER and self.after <= _HALF * self.before and self.before > 1e-6


@dataclass(frozen=True, eq=False)
class Audit:
    """The violations of S(v-) by measured outcomes, each relative to ``|v-|``, (n,).

    Attributes:
        kinematic: penetration.
        kinetic: impulses that pull, leave the friction cones, or are not contact impulses at all.
        energetic: gain of energy.
        momentum: part of the velocity jump that contact impulses of any sign and size cannot cause.
        causes: changes that were tried, the most likely first.
    """

    kinematic: np.ndarray
    kinetic: np.ndarray
    energetic: np.ndarray
    momentum: np.ndarray
    causes: tuple[Cause, ...]

    @property
    def largest(self) -> np.ndarray:
        """The largest of the three violations of each collision, (n,)."""
        return np.max([self.kinematic, self.kinetic, self.energetic], axis=0)

    @property
    def admissible(self) -> float:
        """Share of collisions without a violation above `TOLERANCE`."""
        return float(np.mean(self.largest <= TOLERANCE))

    @property
    def likely_causes(self) -> tuple[Cause, ...]:
        """Changes that would remove most of the violation; empty if there is little violation."""
        return tuple(cause for cause in self.causes if cause.is_likely)


def audit(collisions: Sequence[Collision], post_velocities: Sequence[ArrayLike] | np.ndarray) -> Audit:
    """Return the violations of measured collisions, and the effects of single changes: a sign, an inertia, friction.

    Args:
        collisions: the collisions.
        post_velocities: measured v+ of each collision, (nv,).

    Raises:
        MeasurementError: there are no collisions, or velocities do not fit.
    """
    measured = Measurements(collisions, post_velocities)
    found = np.array([_violations(c, v) for c, v in zip(measured.collisions, measured.post_velocities, strict=True)])
    momentum = _misfits(measured)
    some = measured.select(np.linspace(0, len(measured) - 1, min(len(measured), _SAMPLE)).astype(int))
    causes = _friction(some)
    freedoms = {len(c.pre_velocity) for c in measured.collisions}
    if np.median(momentum) >= _NOTHING and len(freedoms) == 1 and max(freedoms) <= _MOST_FREEDOMS:
        causes = [*_signs(measured, momentum), *_inertias(measured, some, momentum), *causes]
    causes.sort(key=lambda cause: (not cause.is_likely, cause.after - cause.before))
    return Audit(found[:, 0], found[:, 1], found[:, 2], momentum, tuple(causes))


def _violations(c: Collision, v: np.ndarray) -> tuple[float, float, float]:
    try:
        observed = Impact.observed if c.friction is None or not len(c.friction) else FrictionImpact.observed
        found = observed(c, v).violations
    except SolverError:
        return np.inf, np.inf, np.inf
    speed = max(c.pre_speed, 1e-300)
    return found.kinematic / speed, found.kinetic / speed, found.energetic / speed


def _misfits(measured: Measurements, change=None) -> np.ndarray:
    """Return ``|v+ - v- - M^-1 J^T Lambda| / |v-|`` with the best Lambda of any sign, (n,).

    Args:
        measured: the collisions.
        change: a function that changes M, J_n and J_t of a collision, ``(M, J, J_t) -> (M, J, J_t)``.
    """
    misfits = []
    for c, v in zip(measured.collisions, measured.post_velocities, strict=True):
        nv = len(c.pre_velocity)
        J_t = np.zeros((0, nv)) if c.friction is None else c.friction.jacobian
        M, J, J_t = (c.mass_matrix, c.jacobian, J_t) if change is None else change(c.mass_matrix, c.jacobian, J_t)
        rows, jump = np.vstack([J, J_t]), v - c.pre_velocity
        if c.bilateral_jacobian is not None:
            rows = np.vstack([rows, c.bilateral_jacobian])
        R = np.linalg.cholesky(M)
        Y, u = np.linalg.solve(R, rows.T), R.T @ jump
        left = u - Y @ np.linalg.lstsq(Y, u, rcond=1e-10)[0]
        misfits.append(np.linalg.norm(left) / max(np.linalg.norm(R.T @ c.pre_velocity), 1e-300))
    return np.array(misfits)


def _cause(name: str, value: float, before: np.ndarray, after: np.ndarray) -> Cause:
    bad = before > TOLERANCE
    of_bad = float(np.mean((after < before)[bad])) if bad.any() else float("nan")
    told = np.maximum(before, after) > _NOTHING
    better = float(np.mean((after < before)[told])) if told.any() else 0.0
    return Cause(name, value, better, of_bad, float(np.median(before)), float(np.median(after)))


def _signs(measured: Measurements, before: np.ndarray) -> list[Cause]:
    """Try the other sign of each column of the normal and of the tangential rows."""
    causes = []
    nv = len(measured.post_velocities[0])
    for j in range(nv):
        mirror = np.where(np.arange(nv) == j, -1.0, 1.0)
        changes = {
            "tangential": lambda M, J, T, mirror=mirror: (M, J, T * mirror),
            "normal": lambda M, J, T, mirror=mirror: (M, J * mirror, T),
        }
        for kind, change in changes.items():
            after = _misfits(measured, change)
            if not np.allclose(after, before, rtol=0, atol=1e-12):
                causes.append(_cause(f"sign of entry {j} of the {kind} rows", float("nan"), before, after))
    return causes


def _inertias(measured: Measurements, some: Measurements, before: np.ndarray) -> list[Cause]:
    """Try to multiply one diagonal entry of M, a mass or inertia, by a ratio, found on a sample of the collisions."""
    from scipy.optimize import minimize_scalar

    causes = []
    nv = len(measured.post_velocities[0])
    for j in range(nv):

        def misfits(of: Measurements, ratio: float, j: int = j) -> np.ndarray:
            scale = np.where(np.arange(nv) == j, np.sqrt(ratio), 1.0)
            return _misfits(of, lambda M, J, T: (M * np.outer(scale, scale), J, T))

        best = int(np.argmin([np.median(misfits(some, ratio)) for ratio in _RATIOS]))
        near = np.log(_RATIOS[max(best - 1, 0)]), np.log(_RATIOS[min(best + 1, len(_RATIOS) - 1)])
        found = minimize_scalar(lambda x: np.median(misfits(some, np.exp(x))), bounds=near, method="bounded")
        ratio = float(np.exp(found.x))
        causes.append(_cause(f"inertia {j} times", ratio, before, misfits(measured, ratio)))
    return causes


def _friction(some: Measurements) -> list[Cause]:
    """Try other coefficients of friction for the collisions with friction."""
    rubbing = [i for i, c in enumerate(some.collisions) if largest_friction([c])]
    if not rubbing:
        return []
    some = some.select(rubbing)
    largest = largest_friction(some.collisions)

    def kinetic(mu: float | None) -> np.ndarray:
        cs = [c if mu is None else with_friction(c, mu, largest) for c in some.collisions]
        return np.array([_violations(c, v)[1] for c, v in zip(cs, some.post_velocities, strict=True)])

    before = kinetic(None)
    if np.median(before) < 1e-3:
        return []
    tried = [kinetic(mu) for mu in _FRICTIONS]
    best = int(np.argmin([np.median(one) for one in tried]))
    return [_cause("friction", _FRICTIONS[best], before, tried[best])]
