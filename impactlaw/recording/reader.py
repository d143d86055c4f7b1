"""Read a recording."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlaw.errors import RecordingError, UnknownNameError
from impactlaw.recording import layout
from impactlaw.recording.episodes import Episode, episode_table, read_episodes
from impactlaw.recording.properties import PROPERTY_NAMES
from impactlaw.recording.rrd import Entity, file_path, read_entities

if TYPE_CHECKING:
    import pandas as pd

Series = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class WorstViolation:
    """The collision whose outcome violates S(v-) most.

    Attributes:
        index: row of the collision table.
        time: time of the collision, s.
        kind: "kinematic", "kinetic" or "energetic".
        distance: size of the violation in the kinetic metric, sqrt(J).
        relative: the distance divided by ``|v-|``.
    """

    index: int
    time: float
    kind: str
    distance: float
    relative: float


@dataclass(frozen=True, eq=False)
class Recording:
    """A run read with `read_log`.

    Attributes:
        path: the file.
        properties: scene, law, restitution, timestep, integrator, seed, versions.
        collisions: one row per collision, in order. The columns are those in
            `impactlaw.recording.layout.COLLISION_COLUMNS`, and those in `EXTRA_COLUMNS` that the run needs. Columns
            with one value per contact hold lists.
        episodes: the episodes, in order.
    """

    path: Path
    properties: dict[str, Any]
    collisions: pd.DataFrame
    episodes: tuple[Episode, ...] = field(repr=False)
    _series: dict[str, Series] = field(repr=False)

    def episode(self, number: int) -> Episode:
        """Return the episode with a number.

        Raises:
            UnknownNameError: this file has no episode with this number; the message lists the numbers it has.
            RecordingError: this file has no episode at all.
        """
        if not self.episodes:
            raise RecordingError(
                f"{self.path} has no episode yet: a run that goes on is written in parts, and the rest by close()"
            )
        found = [episode for episode in self.episodes if episode.number == number]
        if not found:
            raise UnknownNameError("episode", number, [str(episode.number) for episode in self.episodes])
        return found[0]

    def episode_summary(self) -> pd.DataFrame:
        """Return a table with one row per episode: number, seed, law, length, return, end, collisions."""
        return episode_table(self.episodes, self.collisions)

    @property
    def series_names(self) -> tuple[str, ...]:
        """Names accepted by `series`."""
        return tuple(self._series)

    def series(self, name: str) -> Series:
        """Return times, s, and values of a quantity over the run, float64.

        The following have one value per step: ``energy/kinetic``, ``energy/potential``, ``energy/total`` (J),
        ``contacts/count``, the exact ``qpos`` (n, nq) and ``qvel`` (n, nv), and, for every moving body with a visible
        geom, ``position/<body>`` (n, 3) and ``orientation/<body>`` (n, 4, w first), recorded as float32.
        ``collision/<column>`` has one value per collision. Times are simulation times and start again with each
        episode.

        Raises:
            UnknownNameError: there is no such series; the message suggests similar names.
        """
        if name not in self._series:
            raise UnknownNameError("series", name, self._series)
        return self._series[name]

    def contact_summary(self) -> pd.DataFrame:
        """Return a table with one row per pair of geoms that collided.

        Columns: ``collisions`` in which the pair took part, ``total_impulse`` (N s), ``largest_approach_speed`` (m/s, 0
        if the pair never approached) and ``energy`` (J), the sum of ``Lambda_i gamma_bar_i``, negative if the pair
        dissipated energy. With friction, its work is included in the energy, and ``total_friction`` (N s) is the sum of
        the lengths of the sliding friction impulses.
        """
        numbers = ["impulse", "pre_contact_velocity", "post_contact_velocity"]
        table = self.collisions.explode(["contacts", *numbers]).dropna(subset="contacts")
        table = table.astype(dict.fromkeys(numbers, float))
        before, after = table["pre_contact_velocity"], table["post_contact_velocity"]
        table["approach"] = np.maximum(-before, 0.0) + 0.0
        table["energy"] = table["impulse"] * 0.5 * (before + after)
        sums = {
            "collisions": ("index", "nunique"),
            "total_impulse": ("impulse", "sum"),
            "largest_approach_speed": ("approach", "max"),
            "energy": ("energy", "sum"),
        }
        if "friction_impulse" in self.collisions:
            table["friction"], work = _friction_by_contact(self.collisions)
            table["energy"] += work
            sums["total_friction"] = ("friction", "sum")
        return table.groupby("contacts", sort=False).agg(**sums)

    def worst_violation(self) -> WorstViolation | None:
        """Return the largest violation of S(v-) relative to ``|v-|``; None if there was no collision."""
        if self.collisions.empty:
            return None
        kinds = ("kinematic", "kinetic", "energetic")
        distance = self.collisions[[f"{kind}_violation" for kind in kinds]].to_numpy()
        speed = np.sqrt(2.0 * self.collisions["kinetic_energy"].to_numpy())[:, None]
        if "pre_speed" in self.collisions:  # |v-| relative to moving surfaces
            speed = np.fmax(speed, self.collisions["pre_speed"].to_numpy()[:, None])
        relative = np.divide(distance, speed, out=np.where(distance > 0, np.inf, 0.0), where=speed > 0)
        row, kind = (int(i) for i in np.unravel_index(np.argmax(relative), relative.shape))
        time = float(self.collisions["time"].iloc[row])
        return WorstViolation(row, time, kinds[kind], float(distance[row, kind]), float(relative[row, kind]))


def read_log(path: str | Path) -> Recording:
    """Read a recording; if it was cut off, read everything that was written completely.

    Raises:
        RecordingError: there is no such file, or it is not a recording of this package.
    """
    path = file_path(path)
    entities = read_entities(path)
    properties = _properties(path, entities)
    collisions = _collision_table(entities.get(layout.COLLISIONS))
    series = _frame_series(entities)
    times = series["energy/total"][0] if series else np.zeros(0)
    episodes = read_episodes(entities, times, properties.get("scene"))
    return Recording(path, properties, collisions, episodes, series | _collision_series(collisions))


def _properties(path: Path, entities: dict[str, Entity]) -> dict[str, Any]:
    entity = entities.get(f"__properties/{layout.PROPERTIES}")
    if entity is None or "format" not in entity.static:
        raise RecordingError(f"{path} is not a recording of a run: it has no properties")
    properties = {name: json.loads(entity.static[name][0]) for name in PROPERTY_NAMES if name in entity.static}
    found = properties.pop("format")
    if found != layout.FORMAT:
        raise RecordingError(f"{path} has format {found}, this version of impactlaw reads format {layout.FORMAT}")
    return properties


def _collision_table(entity: Entity | None) -> pd.DataFrame:
    import pandas as pd

    table = {}
    for name, kind in (layout.COLLISION_COLUMNS | layout.EXTRA_COLUMNS).items():
        cells = [] if entity is None else entity.cells(f"{layout.COLLISION}:{name}")
        if not cells and name in layout.EXTRA_COLUMNS:
            continue
        if not cells and entity is not None:  # a file of an older version without this column
            cells = [None] * len(entity.step)
        default = layout.EXTRA_DEFAULTS.get(name)
        several = kind.endswith("s")
        values = [(cell or []) if several else cell[0] if cell else default for cell in cells]
        table[name] = pd.Series(values, dtype={"int": "int64", "float": "float64"}.get(kind, "object"))
    return pd.DataFrame(table)


def _friction_by_contact(collisions: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Return the length of the sliding friction impulse, N s, and the work of friction, J, of each contact."""
    lengths, works = [np.zeros(0)], [np.zeros(0)]
    for row in collisions.to_dict("records"):
        length, work = np.zeros((2, len(row["contacts"])))
        if row["friction_contact"]:
            length[:] = np.linalg.norm(row["tangential_impulse"], axis=1)
            sliding = 0.5 * (np.array(row["pre_sliding_velocity"]) + row["post_sliding_velocity"])
            np.add.at(work, row["friction_contact"], row["friction_impulse"] * sliding)
        lengths.append(length)
        works.append(work)
    return np.concatenate(lengths), np.concatenate(works)


def _frame_series(entities: dict[str, Entity]) -> dict[str, Series]:
    if layout.FRAMES not in entities:
        return {}
    time = entities[layout.FRAMES].numbers(layout.FRAME_TIME)[:, 0]
    n = len(time)  # if the run was cut off, other entities may have more rows
    energy = entities[layout.ENERGY].numbers("Scalars:scalars")[:n]
    series = {f"energy/{name}": (time, energy[:, i]) for i, name in enumerate(layout.ENERGIES)}
    series["contacts/count"] = (time, entities[layout.CONTACTS].counts("Points3D:positions")[:n].astype(float))
    if layout.STATE in entities:
        state = entities[layout.STATE]
        series |= {"qpos": (time, state.numbers(layout.QPOS)[:n]), "qvel": (time, state.numbers(layout.QVEL)[:n])}
    for path, entity in entities.items():
        if path.startswith(f"{layout.SCENE}/") and len(entity.step):
            bodies = entity.static[layout.GEOMETRY_BODIES]
            position = entity.numbers("InstancePoses3D:translations")[:n].reshape(n, -1, 3)
            quaternion = entity.numbers("InstancePoses3D:quaternions")[:n].reshape(n, -1, 4)
            for i, body in enumerate(bodies):
                series[f"position/{body}"] = (time, position[:, i])
                series[f"orientation/{body}"] = (time, quaternion[:, i, [3, 0, 1, 2]])
    return series


def _collision_series(collisions: pd.DataFrame) -> dict[str, Series]:
    time = collisions["time"].to_numpy()
    kinds = layout.COLLISION_COLUMNS | layout.EXTRA_COLUMNS
    numeric = [name for name in collisions if kinds[name] == "float" and name != "time"]
    return {f"collision/{name}": (time, collisions[name].to_numpy()) for name in numeric}
