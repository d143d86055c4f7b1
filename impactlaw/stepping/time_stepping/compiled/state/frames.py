"""The frames that a step has left: data can come back in a state that its frames are not those of."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import equal, plain, put
from impactlaw.stepping.compiled.access import data_floats, size
from impactlaw.stepping.compiled.fields import DATA, MODEL

FRAME = 12
"""Numbers of each body that are kept: one field of each of the stages that bring frames up to the state."""


@plain
def are_left(w, kept):
    """Return whether frames and velocities of bodies are still those that the last step has left."""
    n = size(w, MODEL.nbody)
    return (
        equal(data_floats(w, DATA.xipos, 3 * n), kept[: 3 * n])
        and equal(data_floats(w, DATA.subtree_com, 3 * n), kept[3 * n : 6 * n])
        and equal(data_floats(w, DATA.cvel, 6 * n), kept[6 * n :])
    )


@plain
def keep_frames(w, kept):
    """Keep them at the end of a step."""
    n = size(w, MODEL.nbody)
    put(kept, data_floats(w, DATA.xipos, 3 * n))
    put(kept[3 * n :], data_floats(w, DATA.subtree_com, 3 * n))
    put(kept[6 * n :], data_floats(w, DATA.cvel, 6 * n))
