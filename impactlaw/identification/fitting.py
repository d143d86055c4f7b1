"""Fitting a law to measured collisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from impactlaw.errors import ImpactLawError, MeasurementError, UnknownNameError
from impactlaw.identification.families import FAMILIES, Family, largest_friction, outcomes
from impactlaw.identification.intervals import matrix_intervals, parameter_intervals
from impactlaw.identification.measurements import Measurements, of_contacts, rms
from impactlaw.identification.restitution_matrix import MatrixFit
from impactlaw.identification.searching import SOON, best_parameters
from impactlaw.laws import Fremond, Law, RestitutionLaw, Scattered, energy_gain
from impactlaw.laws.restitution.labels import canonical
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, eq=False)
class Identified:
    """A law that was fitted to measurements.

    Attributes:
        family: the name of its family.
        law: the law, for `Stepper`, environments and studies. Friction belongs to the scene and not to the law; the
            coefficient found is the parameter "friction".
        parameters: the fitted numbers by name.
        confidence: the 95 % confidence interval of each number, for errors that are independent between collisions; nan
            if the data do not determine the number, as for a single collision, or if it is at a bound.
        residuals: ``|P (v^ - v+)| / |P v-|`` of each collision, in the kinetic metric, (n,); see `Measurements`.
        certificate: at most 1 if the law creates no energy. For a law with a restitution matrix it is
            ``|G^-1/2 E G^1/2|_2``, a bound for every velocity at which all contacts close (its square is the largest
            factor on kinetic energy); for other laws the largest ``|v+| / |v-|`` in these collisions.
        rank: the number of directions of ``gamma-`` (family fremond; at most h, that of the least observed contact), or
            of parameters, that the data determine.
        largest: the largest coefficient of friction of the collisions, which the parameter "friction" replaces while
            all coefficients keep their ratios; 0 if the law has no such parameter. Tables without coefficients have 1.
    """

    family: str
    law: Law
    parameters: Mapping[str, float]
    confidence: Mapping[str, tuple[float, float]]
    residuals: np.ndarray
    certificate: float
    rank: int
    largest: float = 0.0

    @property
    def rms(self) -> float:
        """Root of the mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def predict(self, collisions: Sequence[Collision]) -> list[np.ndarray]:
        """Return the predicted v+ of other collisions, with the fitted friction, (nv,) each.

        Raises:
            MeasurementError: the law has friction, but no collision has tangential directions.
        """
        friction = self.parameters.get("friction")
        if friction is not None and not largest_friction(collisions):
            raise MeasurementError(
                f"the collision of {', '.join(collisions[0].labels)} has no tangential directions, which a coefficient "
                "of friction is for, nor has another: give it rows of friction (Collision(..., friction=Friction(...)))"
            )
        return outcomes(self.law, collisions, friction, self.largest)


def fit(
    collisions: Sequence[Collision],
    post_velocities: Sequence[ArrayLike] | np.ndarray,
    family: str = "newton",
    *,
    contacts: str | Sequence[str] | None = None,
    admissible: bool = False,
    projected: bool = False,
) -> Identified:
    """Return the law of a family that fits measured collisions best, by least squares of relative errors.

    Args:
        collisions: the collisions, for example from `read_collisions`.
        post_velocities: measured v+ of each collision, (nv,).
        family: "moreau", "newton", "poisson", "reversal", "fremond", "coulomb", "routh" or "compliant".
        contacts: labels of the set of closed contacts whose collisions are used, or the label of one contact; by
            default all collisions are used. A full matrix (fremond) belongs to one set.
        admissible: whether to restrict E (fremond) to ``E >= 0`` and ``G^-1 (1 + E) >= 0``, so that no ``gamma- <= 0``
            leads to penetration or pulling.
        projected: whether the law found projects its outcome onto S(v-), which never increases the error of outcomes
            measured in S(v-). The law is then `Scattered` with variance 0. Not for the laws with friction, "coulomb"
            and "routh".

    Raises:
        UnknownNameError: there is no such family.
        MeasurementError: the data do not determine the law, or the option is not for this family.
    """
    measured = checked(collisions, post_velocities, family, contacts)
    fitted = _family(family, measured, projected=projected)
    if admissible and fitted is not None:
        raise MeasurementError(f"admissible=True restricts a full matrix, family 'fremond', not {family!r}")
    return _fit(measured, fitted, admissible=admissible, projected=projected)


def _family(name: str, measured: Measurements, *, projected: bool) -> Family | None:
    """Return the family for the contacts of the measurements; None for a full matrix."""
    make = FAMILIES[name]
    family = None if make is None else make(measured)
    if projected and family is not None and family.largest:
        raise MeasurementError(f"projected=True leaves out the friction that family {name!r} is about")
    return family


def _fit(measured: Measurements, family: Family | None, *, admissible: bool, projected: bool) -> Identified:
    found = _fit_matrix(measured, admissible=admissible) if family is None else _fit_parameters(measured, family)
    if not projected:
        return found
    law = Scattered(found.law, 0.0)
    return replace(found, law=law, residuals=_lengths(measured.errors(outcomes(law, measured.collisions))))


def checked(
    collisions: Sequence[Collision],
    post_velocities: Sequence[ArrayLike] | np.ndarray,
    family: str,
    contacts: str | Sequence[str] | None,
) -> Measurements:
    """Return the measurements of a set of contacts, or all if it is None, after checking the arguments of `fit`."""
    if family not in FAMILIES:
        raise UnknownNameError("family", family, FAMILIES)
    measured = Measurements(collisions, post_velocities)
    if contacts is None:
        return measured
    return measured.select(of_contacts(contacts, measured.contact_sets))


def _fit_parameters(measured: Measurements, family: Family) -> Identified:
    low = np.array([p.low for p in family.parameters])
    high = np.array([p.high for p in family.parameters])
    sizes = [len(Q) for Q in measured.bases]

    def residual(x: np.ndarray) -> np.ndarray:
        try:
            return np.concatenate(measured.errors(family.predicted(measured, np.clip(x, low, high))))
        except ImpactLawError as error:
            raise MeasurementError(f"family {family.name!r} does not fit these collisions: {error}") from None

    x = best_parameters(residual, family, len(sizes))
    intervals, rank = parameter_intervals(residual, x, sizes, low, high)
    names = [p.name for p in family.parameters]
    law = family.make(x)
    return Identified(
        family.name,
        law,
        dict(zip(names, x.tolist(), strict=True)),
        dict(zip(names, intervals, strict=True)),
        _lengths(np.split(residual(x), np.cumsum(sizes)[:-1])),
        _certificate(law, measured, family, x),
        rank,
        family.largest,
    )


def _certificate(law: Law, measured: Measurements, family: Family, x: np.ndarray) -> float:
    if isinstance(law, RestitutionLaw):
        return float(np.sqrt(max(energy_gain(c, law.restitution_matrix(c)) for c in measured.collisions)))
    pairs = zip(measured.collisions, family.predicted(measured, x), strict=True)
    after = ((c.relative_velocity + c.metric.whiten(v - c.pre_velocity), c.pre_speed) for c, v in pairs)
    return max(float(np.linalg.norm(velocity)) / before for velocity, before in after)


def _lengths(errors: Sequence[np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(error) for error in errors])


def _fit_matrix(measured: Measurements, *, admissible: bool) -> Identified:
    sets = measured.contact_sets
    if len(sets) > 1:
        counts = "; ".join(f"{' '.join(labels)} ({len(which)})" for labels, which in sets.items())
        raise MeasurementError(
            f"a restitution matrix belongs to one set of closed contacts, but there are {len(sets)}: {counts}; choose "
            "one by contacts, on the command line by --contacts"
        )
    first = measured.collisions[0]
    if first.friction is not None and len(first.friction):
        raise MeasurementError("family 'fremond' is for contacts without friction; leave tangential directions out")
    labels = tuple(map(canonical, first.labels))
    unique = len(set(labels)) == len(labels)
    here = range(len(labels))
    order = np.array(
        [[list(map(canonical, c.labels)).index(a) for a in labels] if unique else here for c in measured.collisions]
    )
    problem = MatrixFit(measured, order)
    F, active = problem.solve(admissible=admissible)
    E = problem.matrix(F)
    intervals, rank = matrix_intervals(problem, F, active)
    pairs = list(product(here, here))
    names = labels if unique else tuple(map(str, here))
    keys = [f"E {names[i]}, {names[j]}" for i, j in pairs]
    law = Fremond({(labels[i], labels[j]): float(E[i, j]) for i, j in pairs} if unique else E)
    return Identified(
        "fremond",
        law,
        {key: float(E[pair]) for key, pair in zip(keys, pairs, strict=True)},
        {key: intervals[pair] for key, pair in zip(keys, pairs, strict=True)},
        _lengths(measured.errors(outcomes(law, measured.collisions))),
        problem.bound(F),
        rank,
    )


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors of a family on collisions that its law has not seen.

    Attributes:
        family: the name of the family.
        rms: root of the mean square of ``|P (v^ - v+)| / |P v-|`` over all collisions, each held out once.
        fold_rms: the same for each fold, (folds,).
        parameters: the parameters fitted without each fold, one mapping per fold.
    """

    family: str
    rms: float
    fold_rms: np.ndarray
    parameters: tuple[Mapping[str, float], ...]


def cross_validate(
    collisions: Sequence[Collision],
    post_velocities: Sequence[ArrayLike] | np.ndarray,
    family: str = "newton",
    *,
    folds: int = 5,
    seed: int = 0,
    contacts: str | Sequence[str] | None = None,
    projected: bool = False,
) -> CrossValidation:
    """Fit the family to all folds but one, predict that one, and repeat this for each fold.

    Parameters of contacts that occur in the held-out fold only keep their initial values.

    Args:
        collisions: the collisions.
        post_velocities: measured v+ of each collision, (nv,).
        family: see `fit`.
        folds: number of parts into which the collisions are split at random.
        seed: seed of the split.
        contacts: see `fit`.
        projected: see `fit`.

    Raises:
        UnknownNameError: there is no such family.
        MeasurementError: there are fewer collisions than folds or fewer than two folds, or see `fit`.
    """
    measured = checked(collisions, post_velocities, family, contacts)
    n = len(measured)
    check_folds(folds, n)
    errors, fold_rms, parameters, fitted = [], [], [], _family(family, measured, projected=projected)
    parts = np.array_split(np.random.default_rng(seed).permutation(n), folds)
    for part in tqdm(parts, desc=f"folds of {family}", leave=False, delay=SOON, disable=None):
        rest, held = measured.select(np.setdiff1d(np.arange(n), part)), measured.select(part)
        found = _fit(rest, fitted, admissible=False, projected=projected)
        own = held.errors(outcomes(found.law, held.collisions, found.parameters.get("friction"), found.largest))
        errors += own
        fold_rms.append(rms(own))
        parameters.append(found.parameters)
    return CrossValidation(family, rms(errors), np.array(fold_rms), tuple(parameters))


def check_folds(folds: int, n: int) -> None:
    """Raise `MeasurementError` if n collisions cannot be split into so many folds."""
    if not isinstance(folds, Integral) or not 2 <= folds <= n:
        raise MeasurementError(f"{n} collision{'s' if n > 1 else ''} cannot be split into {folds!r} folds: 2 to {n}")
