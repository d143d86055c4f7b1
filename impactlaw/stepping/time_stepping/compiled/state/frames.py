"""The frames at the end of a step: a state can be restored in data without its frames."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import equal, plain, put
from impactlaw.stepping.compiled.access import data_floats, size
from impactlaw.stepping.compiled.fields import DATA, MODEL

FRAME = 12
"""Number of values kept for each body: one field of each stage that updates frames to the state."""


@plain
def are_left(w, kept):
    """Return whether frames and velocities of bodies are still those at the end of the last step."""
    n = size(w, MODEL.nbody)
    return (
        equal(data_floats(w, DATA.xipos, 3 * n), kept[: 3 * n])
        and equal(data_floats(w, DATA.subtree_com, 3 * n), kept[3 * n : 6 * n])
        and equal(data_floats(w, DATA.cvel, 6 * n), kept[6 * n :])
    )


@plain
def keep_frames(w, kept):
    """Store frames and velocities of bodies at the end of a step."""
    n = size(w, MODEL.nbody)
    put(kept, data_floats(w, DATA.xipos, 3 * n))
    put(kept[3 * n :], data_floats(w, DATA.subtree_com, 3 * n))
    put(kept[6 * n :], data_floats(w, DATA.cvel, 6 * n))
