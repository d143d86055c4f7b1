"""What a recording file holds and where: the one place that writer and reader share."""

from __future__ import annotations

from typing import TYPE_CHECKING

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
GEOMETRY_BODIES = "impactlaw.Geometry:bodies"
COLLISION = "impactlaw.Collision"
COLLISION_COLUMNS = {
    "index": "int",
    "episode": "int",
    "step": "int",
    "time": "float",
    "law": "text",
    "contacts": "texts",
    "pre_contact_velocity": "floats",
    "post_contact_velocity": "floats",
    "impulse": "floats",
    "topology": "floats",
    "antidissipative": "bools",
    "position": "vectors",
    "normal": "vectors",
    "intensity": "float",
    "induced_impulse": "float",
    "kinetic_energy": "float",
    "energy_change": "float",
    "kinematic_violation": "float",
    "kinetic_violation": "float",
    "energetic_violation": "float",
    "residual": "float",
}
"""The collision table: what one cell is; plural means one value per contact. Floats are float64."""


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
