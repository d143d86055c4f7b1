"""The output of `impactlaw identify`: a table of families, the law as JSON, a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from impactlaw.errors import ImpactLawError, MeasurementError
from impactlaw.identification.auditing import TOLERANCE, Audit, audit
from impactlaw.identification.families import FAMILIES, outcomes
from impactlaw.identification.fitting import CrossValidation, Identified, check_folds, checked, cross_validate, fit
from impactlaw.identification.reading import Collisions, read_collisions
from impactlaw.laws.restitution.portable import portable

_FOLDS = 5  # if not given
_UNTOLD = " (?)"
_SHOWN = 6  # parameters in a line of the table
_WORST = 0.5  # share of collisions that must be admissible for a fit to make sense


@dataclass(frozen=True, eq=False)
class Row:
    """A row of the table: the law of a family and its errors on unseen collisions, or the reason why it has none."""

    family: str
    law: Identified | None
    held_out: CrossValidation | None
    reason: str = ""

    @property
    def error(self) -> float:
        """The error on unseen collisions, by which families are compared."""
        return np.inf if self.held_out is None else self.held_out.rms


@dataclass(frozen=True, eq=False)
class Study:
    """All results for one file."""

    measured: Collisions  # the collisions read, of the chosen set of contacts
    audit: Audit  # the audit of these collisions
    rows: tuple[Row, ...]  # one row for each family
    best: Row  # the row with the least error on unseen collisions; among equally good ones that with fewest parameters
    folds: int  # number of parts into which the collisions were split for these errors


def study(
    path: Path, *, family: str | None = None, folds: int | None = None, contacts: Sequence[str] | None = None
) -> Study:
    """Read a file, audit it, and fit one family, or all families by default.

    The default number of folds is 5, or the number of collisions if that is less.

    Raises:
        MeasurementError: the file cannot be read, its collisions are too few or not valid, or no family fits.
        UnknownNameError: there is no such family.
    """
    names = [family] if family is not None else list(FAMILIES)
    measured = _chosen(path, names[0], contacts)
    n = len(measured.collisions)
    if n < 2:
        these = "" if contacts is None else f" of the contacts {', '.join(measured.collisions[0].labels)}"
        raise MeasurementError(f"{path} has 1 collision{these}: a law is identified from 2 or more")
    if not any((v != c.pre_velocity).any() for c, v in zip(*measured, strict=True)):
        raise MeasurementError(f"{path}: no collision changes a velocity: they tell nothing of a law")
    found = audit(*measured)
    if found.admissible < _WORST:
        raise MeasurementError(f"{path}: {refusal(found)}")
    folds = max(2, min(_FOLDS, n)) if folds is None else folds
    try:
        check_folds(folds, n)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    rows = []
    with tqdm(names, desc="families", leave=False, disable=None) as bar:
        for name in bar:
            bar.set_postfix_str(name)
            rows.append(_row(name, measured, folds))
    fitted = [row for row in rows if row.law is not None and row.held_out is not None]
    if not fitted:
        raise MeasurementError(f"{path}: {rows[0].reason}" if family else f"{path}: no family fits: {rows[0].reason}")
    least = min(row.error for row in fitted)
    good = [row for row in fitted if row.error <= least * (1 + 1e-3) + 1e-9]
    best = min(good, key=lambda row: len(row.law.parameters) if row.law else 0)
    return Study(measured, found, tuple(rows), best, folds)


def _chosen(path: Path, family: str, contacts: Sequence[str] | None) -> Collisions:
    """Return the collisions of a set of contacts, or all if it is None."""
    read = read_collisions(path, contacts=contacts)
    try:
        chosen = checked(*read, family, contacts)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    return Collisions(list(chosen.collisions), list(chosen.post_velocities))


def _row(name: str, measured: Collisions, folds: int) -> Row:
    try:
        law = fit(*measured, name)
        if law.rank == 0:
            return Row(name, None, None, "the collisions tell none of its numbers, or none of a contact (rank 0)")
        return Row(name, law, cross_validate(*measured, name, folds=folds))
    except ImpactLawError as error:
        return Row(name, None, None, str(error))


def refusal(found: Audit) -> str:
    """Return a one-line message on collisions most of which violate physics."""
    medians = {name: float(np.median(getattr(found, name))) for name in ("kinematic", "kinetic", "energetic")}
    worst = max(medians, key=lambda name: medians[name])
    text = (
        f"only {found.admissible:.0%} of {len(found.kinetic)} collisions are admissible within {TOLERANCE:g} |v-|, the "
        f"median {worst} violation is {medians[worst]:.3g} |v-|: no law fits that"
    )
    if not found.likely_causes:
        return f"{text}; check units and signs"
    cause = found.likely_causes[0]
    value = "" if np.isnan(cause.value) else f" {cause.value:.3g}"
    return (
        f"{text}; likely cause: {cause.name}{value} (with another one {cause.better:.0%} of collisions fit better, "
        f"median {cause.before:.3g} -> {cause.after:.3g})"
    )


def format_study(found: Study) -> str:
    """Return the table for the screen."""
    n = len(found.measured.collisions)
    lines = [
        f"{n} collisions, {found.audit.admissible:.0%} admissible within {TOLERANCE:g} |v-|; {found.folds} folds",
        "",
    ]
    lines.append(f"{'family':<11}{'held out':>9}{'fit':>9}{'certificate':>13}{'rank':>6}  parameters (95 %)")
    for row in sorted(found.rows, key=lambda row: row.error):
        if row.law is not None:
            numbers = f"{row.error:>9.4f}{row.law.rms:>9.4f}{row.law.certificate:>13.6f}{row.law.rank:>6}"
            lines.append(f"{row.family:<11}{numbers}  {parameters_in_words(row.law)}")
    lines += [f"{row.family:<11}not fitted: {row.reason}" for row in found.rows if row.law is None]
    if any(_UNTOLD in line for line in lines):
        lines += ["", f"{_UNTOLD.strip()}: at a bound, or the collisions do not tell this number"]
    lines.append(f"\nbest: {found.best.family}")
    return "\n".join(lines)


def parameters_in_words(law: Identified) -> str:
    """Return the first few parameters with the half widths of their intervals, as text."""
    parts = []
    for name, value in list(law.parameters.items())[:_SHOWN]:
        low, high = law.confidence[name]
        parts.append(f"{name} {value:.4f}" + (_UNTOLD if np.isnan(low) else f" +- {0.5 * (high - low):.4f}"))
    more = len(law.parameters) - _SHOWN
    return ", ".join(parts) + (f" and {more} more" if more > 0 else "")


def write_law(law: Identified, path: Path, source: str) -> None:
    """Write the law and the quality of its fit as JSON, which `make_law` reads."""
    value = {
        "law": portable(law.law),
        "family": law.family,
        "parameters": dict(law.parameters),
        "confidence": {name: [None if np.isnan(x) else x for x in pair] for name, pair in law.confidence.items()},
        "rms": law.rms,
        "certificate": law.certificate,
        "rank": law.rank,
        "source": source,
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise MeasurementError(f"cannot write {path}: {error.strerror}") from None


def draw(found: Study, path: Path, title: str) -> None:
    """Write a picture: predicted over observed contact velocities for the best law, and the errors of all families."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    figure.suptitle(title.replace("$", r"\$"), fontsize=10)
    left, right = figure.subplots(1, 2)
    law = found.best.law
    assert law is not None
    predicted = outcomes(law.law, found.measured.collisions, law.parameters.get("friction"), law.largest)
    for c, seen, after in zip(*found.measured, predicted, strict=True):
        left.plot(c.contact_velocity_after(seen), c.contact_velocity_after(after), ".", color="C0", markersize=3)
    ends = np.array(left.get_xlim())
    left.plot(ends, ends, color="0.6", linewidth=0.8)
    left.set_xlabel("contact velocity observed, m/s or rad/s")
    left.set_ylabel(f"predicted, {found.best.family}")
    rows = sorted((row for row in found.rows if row.held_out is not None), key=lambda row: -row.error)
    right.barh([row.family for row in rows], [row.error for row in rows], color="C0")
    right.set_xlabel("error on unseen collisions, of |v-|")
    right.xaxis.set_major_locator(MaxNLocator(4))
    try:
        figure.savefig(path, dpi=80)
    except OSError as error:
        raise MeasurementError(f"cannot write {path}: {error.strerror}") from None
