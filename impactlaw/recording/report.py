"""Describe a recording as text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from impactlaw.mechanics.admissible.violations import CRUSHED

if TYPE_CHECKING:
    import pandas as pd

    from impactlaw.recording.reader import Recording

_COLUMNS = ["time", "contacts", "induced_impulse", "intensity", "energy_change", "distant"]
_ROUNDING = 1e-9  # violation, relative to |v-|


def describe(recording: Recording, *, limit: int = 50) -> str:
    """Return the text that `impactlaw inspect` prints: properties, episodes, contacts, worst violation, collisions.

    Args:
        recording: a recording read with `read_log`.
        limit: largest number of episodes, and of collisions, to list.
    """
    parts = [_properties(recording), _extent(recording), _episodes(recording, limit)]
    if not recording.collisions.empty:
        pairs = recording.contact_summary().reset_index()
        parts += ["contacts\n" + _table(pairs, len(pairs)), _violation(recording)]
        parts.append(_collisions(recording.collisions, limit))
    return "\n\n".join(part for part in parts if part)


def _properties(recording: Recording) -> str:
    values: dict[str, Any] = {"recording": recording.path} | recording.properties
    versions = ", ".join(f"{name} {version}" for name, version in values.pop("versions").items())
    values = {name: "-" if value is None or value == "" else value for name, value in values.items()}
    return "\n".join(f"{name:<12}{value}" for name, value in (values | {"versions": versions}).items())


def _extent(recording: Recording) -> str:
    collisions = len(recording.collisions)
    counted = f"{collisions} collision{'' if collisions == 1 else 's'}"
    if "energy/total" not in recording.series_names:
        return f"no complete steps, {counted}"
    time, energy = recording.series("energy/total")
    if len(recording.episodes) > 1:
        seconds = sum(float(episode.time[-1] - episode.time[0]) for episode in recording.episodes)
        return f"{len(time)} states in {len(recording.episodes)} episodes, {seconds:.6g} s, {counted}"
    return f"{len(time)} states up to t = {time[-1]:.6g} s, {counted}; energy {energy[0]:.6g} J -> {energy[-1]:.6g} J"


def _episodes(recording: Recording, limit: int) -> str:
    """Return one line per episode; an empty text for a single episode without environment steps."""
    table = recording.episode_summary()
    told = any(len(episode.rewards) for episode in recording.episodes)
    if len(table) < 2 and not told:
        return ""
    shown = table.head(limit).fillna({"law": "-"})
    if not told:
        shown = shown.drop(columns=["steps", "return", "ended"])
    return "episodes\n" + _table(shown, len(table))


def _violation(recording: Recording) -> str:
    worst = recording.worst_violation()
    if worst is None or worst.distance == 0:
        return "no violation: every outcome lies in S(v-)"
    if worst.relative < _ROUNDING:
        return "no violation beyond rounding: every outcome lies in S(v-)"
    size = f"{worst.distance:.3g} sqrt(J), {worst.relative:.3g} of |v-|"
    if worst.kind == "kinematic" and np.isinf(worst.distance):
        size = CRUSHED
    return f"worst violation: {worst.kind}, {size}, in collision {worst.index} at t = {worst.time:.6g} s"


def _collisions(collisions: pd.DataFrame, limit: int) -> str:
    shown = collisions.head(limit)
    shown = shown.assign(
        contacts=shown["contacts"].map(", ".join),
        distant=shown["antidissipative"].map(lambda given: "yes" if any(given) else ""),
    )
    columns = list(_COLUMNS)
    if "tangential_impulse" in shown:
        shown = shown.assign(friction=[sum(map(np.linalg.norm, cell)) for cell in shown["tangential_impulse"]])
        columns += ["friction", "restitution_scale"]
    columns += [name for name in ("surface_work", "bilateral_rows") if name in shown]
    return "collisions\n" + _table(shown.loc[:, columns], len(collisions), index=True)


def _table(shown: pd.DataFrame, rows: int, *, index: bool = False) -> str:
    """Return the shown part of a table as text, and how many of its rows are left out."""
    text = shown.to_string(index=index, float_format=lambda x: f"{x:.6g}", max_colwidth=60)
    return text if len(shown) == rows else f"{text}\n... and {rows - len(shown)} more"
