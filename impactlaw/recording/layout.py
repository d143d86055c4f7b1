"""What a recording file holds and where: the one place that writer and reader share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pyarrow

APPLICATION = "impactlaw"
FORMAT = 1
"""Version of this layout; a file with another one is refused by the reader."""

SIM_TIME = "sim_time"  # timeline: seconds, episodes one after the other
STEP = "step"  # timeline: frames from 0
PROPERTIES = "impactlaw"  # name of the recording property, one JSON text per value
SCENE, CONTACTS, ENERGY, COLLISIONS, MARKS = "scene", "contacts", "energy", "collisions", "collisions/marks"
FRAMES = "frames"  # the exact times; apart from the energies, with which the viewer would plot them

ENERGIES = ("kinetic", "potential", "total")
PLOTTED = ("intensity", "energy_change")  # columns of a collision that have a plot of their own

FRAME_TIME = "impactlaw.Frame:time"
STATE, STEPS, EPISODES = "state", "steps", "episodes"
QPOS, QVEL = "impactlaw.State:qpos", "impactlaw.State:qvel"
EPISODE, TAKEN = "impactlaw.Episode", "impactlaw.Step"
STEP_COLUMNS = {"action": "floats", "kind": "text", "reward": "float", "terminated": "bool", "truncated": "bool"}
"""What an environment step was told and gave, at the frame that it ends with; ``kind`` is type and shape of the action,
as JSON."""
EPISODE_COLUMNS = {"number": "int", "seed": "int"} | dict.fromkeys(("law", "generator", "settings", "made"), "text")
"""How an episode began, at its first frame; the last three are JSON, and empty cells are what is not known."""
CHANGES, CHANGE = "episodes/laws", "impactlaw.LawChange"
CHANGE_COLUMNS = {"law": "text", "value": "text"}
"""A law that was set within an episode, at the first frame under it; ``value`` is JSON."""
MARKED = {EPISODES: (EPISODE, EPISODE_COLUMNS), STEPS: (TAKEN, STEP_COLUMNS), CHANGES: (CHANGE, CHANGE_COLUMNS)}
GEOMETRY_BODIES = "impactlaw.Geometry:bodies"
COLLISION = "impactlaw.Collision"
COLLISION_COLUMNS = {
    "index": "int", "episode": "int", "step": "int", "time": "float", "law": "text", "contacts": "texts",
    "pre_contact_velocity": "floats", "post_contact_velocity": "floats", "impulse": "floats", "topology": "floats",
    "antidissipative": "bools", "position": "vectors", "normal": "vectors", "intensity": "float",
    "induced_impulse": "float", "kinetic_energy": "float", "energy_change": "float", "kinematic_violation": "float",
    "kinetic_violation": "float", "energetic_violation": "float", "residual": "float", "delassus": "floats",
}  # fmt: skip
"""The collision table: what one cell is; plural means one value per contact. Floats are float64.

``delassus`` is G of the contacts, and of their rows of friction after these, (h + k, h + k), row by row; empty where
there are more than `MOST_COUPLED` rows, and in files of older versions, which have no such column."""
MOST_COUPLED = 64

EXTRA_COLUMNS = {
    "friction_contact": "ints", "friction_coefficient": "floats", "friction_impulse": "floats",
    "pre_sliding_velocity": "floats", "post_sliding_velocity": "floats", "tangential_impulse": "vectors",
    "restitution_scale": "float",
    "surface_velocity": "floats", "post_surface_velocity": "floats", "surface_work": "float", "pre_speed": "float",
    "bilateral_rows": "int",
}  # fmt: skip
"""Columns that a file has only if a collision in it has friction, moving surfaces or bilateral constraints.

Coefficients of friction (1, or m), friction impulses (N s, or N m s) and sliding velocities (m/s, or rad/s) have one
value per row of friction, which belongs to the contact ``friction_contact``; ``tangential_impulse`` is that of sliding,
per contact, in the world frame. Of a collision without any of it a cell is empty, or has the value in
`EXTRA_DEFAULTS`."""
EXTRA_DEFAULTS: dict[str, float | int] = {
    "restitution_scale": 1.0, "surface_work": 0.0, "pre_speed": float("nan"), "bilateral_rows": 0,
}  # fmt: skip


def cell_type(kind: str) -> pyarrow.DataType:
    """Return the arrow type of one value of a cell of that kind."""
    import pyarrow as pa

    return {
        "int": pa.int64(),
        "float": pa.float64(),
        "text": pa.string(),
        "bool": pa.bool_(),
        "vector": pa.list_(pa.float64(), 3),
    }[kind.removesuffix("s")]


class Column:
    """One column of own values; rerun's own ``AnyValues`` would drop an empty one.

    Args:
        name: ``"archetype:component"``.
        kind: see `impactlaw.recording.layout.cell_type`; plural when a cell is a sequence.
        cells: one per row; None leaves it empty.
    """

    def __init__(self, name: str, kind: str, cells: Sequence[Any] | np.ndarray):
        import pyarrow as pa

        rows = [[] if cell is None else cell if kind.endswith("s") else [cell] for cell in cells]
        self._name = name
        self._array = pa.array(rows, pa.list_(cell_type(kind)))

    def component_descriptor(self) -> Any:
        """Return rerun's description of the column."""
        import rerun as rr

        return rr.ComponentDescriptor(self._name, archetype=self._name.partition(":")[0])

    def as_arrow_array(self) -> Any:
        """Return the cells."""
        return self._array


def time_columns(clock: Sequence[float] | np.ndarray, step: Sequence[int] | np.ndarray) -> list[Any]:
    """Return the two timelines of rows at these times, in s, and frames."""
    import rerun as rr

    nanoseconds = np.rint(1e9 * np.asarray(clock, dtype=float)).astype("timedelta64[ns]")
    return [rr.TimeColumn(SIM_TIME, duration=nanoseconds), rr.TimeColumn(STEP, sequence=np.asarray(step))]
