"""The layout of a recording file, shared by writer and reader: names and types of its entities and columns."""

from collections.abc import Sequence
from typing import Any

import numpy as np

APPLICATION = "impactlaw"
FORMAT = 1
"""Version of this layout; the reader refuses files with another version."""

SIM_TIME = "sim_time"  # timeline: seconds, episodes one after the other
STEP = "step"  # timeline: frames from 0
PROPERTIES = "impactlaw"  # name of the recording property, one JSON text per value
SCENE, CONTACTS, ENERGY, COLLISIONS, MARKS = "scene", "contacts", "energy", "collisions", "collisions/marks"
FRAMES = "frames"  # exact times, in an entity of their own: the viewer would plot them together with the energies

ENERGIES = ("kinetic", "potential", "total")
PLOTTED = ("intensity", "energy_change")  # columns of collisions that the viewer plots

FRAME_TIME = "impactlaw.Frame:time"
STATE, STEPS, EPISODES = "state", "steps", "episodes"
QPOS, QVEL = "impactlaw.State:qpos", "impactlaw.State:qvel"
EPISODE, TAKEN = "impactlaw.Episode", "impactlaw.Step"
STEP_COLUMNS = {"action": "floats", "kind": "text", "reward": "float", "terminated": "bool", "truncated": "bool"}
"""Columns of an environment step, at its last frame; ``kind`` is the type and shape of the action, as JSON."""
EPISODE_COLUMNS = {"number": "int", "seed": "int"} | dict.fromkeys(("law", "generator", "settings", "made"), "text")
"""Columns of the start of an episode, at its first frame; the last three are JSON, and unknown values are empty."""
CHANGES, CHANGE = "episodes/laws", "impactlaw.LawChange"
CHANGE_COLUMNS = {"law": "text", "value": "text"}
"""Columns of a law set within an episode, at the first frame under it; ``value`` is JSON."""
MODELS, REMADE = "episodes/models", "impactlaw.ModelChange"
REMADE_COLUMNS = {"made": "text"}
"""Columns of a model changed within an episode, at the first frame with it; ``made`` is JSON, as that of an episode."""
STATES, MOVED = "episodes/states", "impactlaw.StateChange"
MOVED_COLUMNS = {"changed": "bool"}
"""Columns of a state that was changed within an episode other than by a step, at the first frame after it; true."""
MARKED = {
    EPISODES: (EPISODE, EPISODE_COLUMNS),
    STEPS: (TAKEN, STEP_COLUMNS),
    CHANGES: (CHANGE, CHANGE_COLUMNS),
    MODELS: (REMADE, REMADE_COLUMNS),
    STATES: (MOVED, MOVED_COLUMNS),
}
GEOMETRY_BODIES = "impactlaw.Geometry:bodies"
COLLISION = "impactlaw.Collision"
COLLISION_COLUMNS = {
    "index": "int", "episode": "int", "step": "int", "time": "float", "law": "text", "contacts": "texts",
    "pre_contact_velocity": "floats", "post_contact_velocity": "floats", "impulse": "floats", "topology": "floats",
    "antidissipative": "bools", "position": "vectors", "normal": "vectors", "intensity": "float",
    "induced_impulse": "float", "kinetic_energy": "float", "energy_change": "float", "kinematic_violation": "float",
    "kinetic_violation": "float", "energetic_violation": "float", "residual": "float", "delassus": "floats",
}  # fmt: skip
"""Types of the cells of the collision table; a plural means one value per contact. Floats are float64.

``delassus`` is the Delassus matrix G of the contacts, followed by their rows of friction, (h + k, h + k), row by row.
It is empty if there are more than `MOST_COUPLED` rows, and in files of older versions without this column."""
MOST_COUPLED = 64

EXTRA_COLUMNS = {
    "friction_contact": "ints", "friction_coefficient": "floats", "friction_impulse": "floats",
    "pre_sliding_velocity": "floats", "post_sliding_velocity": "floats", "tangential_impulse": "vectors",
    "restitution_scale": "float",
    "surface_velocity": "floats", "post_surface_velocity": "floats", "surface_work": "float", "pre_speed": "float",
    "bilateral_rows": "int",
}  # fmt: skip
"""Columns that a file has only if one of its collisions has friction, moving surfaces or bilateral constraints.

Coefficients of friction (1, or m), friction impulses (N s, or N m s) and sliding velocities (m/s, or rad/s) have one
value per row of friction, which belongs to the contact ``friction_contact``. ``tangential_impulse`` is the impulse of
sliding friction of each contact, in the world frame. For a collision without these features a cell is empty, or has the
value in `EXTRA_DEFAULTS`."""
EXTRA_DEFAULTS: dict[str, float | int] = {
    "restitution_scale": 1.0, "surface_work": 0.0, "pre_speed": float("nan"), "bilateral_rows": 0,
}  # fmt: skip


def cell_type(kind: str) -> Any:
    """Return the arrow type of one value in a cell of a kind, such as "float" or "floats"."""
    import pyarrow as pa

    return {
        "int": pa.int64(),
        "float": pa.float64(),
        "text": pa.string(),
        "bool": pa.bool_(),
        "vector": pa.list_(pa.float64(), 3),
    }[kind.removesuffix("s")]


class Column:
    """A column of values for rerun; rerun's own ``AnyValues`` would drop empty columns.

    Args:
        name: ``"archetype:component"``.
        kind: see `impactlaw.recording.layout.cell_type`; plural if a cell is a sequence.
        cells: one cell per row; None for an empty cell.
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
    """Return the two timelines of rows, from their times, s, and frames."""
    import rerun as rr

    nanoseconds = np.rint(1e9 * np.asarray(clock, dtype=float)).astype("timedelta64[ns]")
    return [rr.TimeColumn(SIM_TIME, duration=nanoseconds), rr.TimeColumn(STEP, sequence=np.asarray(step))]
