"""One scene under several laws and under MuJoCo's soft contacts."""

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Positional

__all__ = ["Comparison"]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What to compare."""

    scene: Annotated[str, Positional] = "newtons_cradle"
    """Name of a scene (see `impactlaw scenes`) or path of an MJCF file."""
    laws: tuple[str, ...] | None = None
    """Names of laws (see `impactlaw laws`) but fremond, which needs a matrix; files such as law.json; "scene" for the
    law of the MJCF. If not given: maximal-dissipation, moreau, reversal, and scene if geoms differ in restitution."""
    restitution: float | None = None
    """Coefficient of restitution of every law that takes one: all but maximal-dissipation, any-outcome, scene. If not
    given, that of the scene, or 1."""
    duration: float | None = None
    """Simulated time, s; the scene's own, or 2, if not given."""
    timestep: float | None = None
    """Timestep, s; the scene's own if not given."""
    friction: Literal["coulomb", "convex", "ignore"] = "coulomb"
    """Friction of rigid contacts: exact Coulomb friction, its convex relaxation, or none."""
    scheme: Literal["event-driven", "time-stepping"] = "event-driven"
    """event-driven locates every collision in time; time-stepping resolves all contact once a step at bounded cost."""
    view: bool = False
    """Open the rerun viewer on the runs as they happen; needs a display."""
