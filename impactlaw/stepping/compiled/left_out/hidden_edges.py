"""Contacts with edges that a floor of several pieces hides, in compiled code; see `scene.corrected.hidden_edges`."""

from __future__ import annotations

from typing import Any

from numba import extending

from impactlaw.scene.corrected import hidden_edges
from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones.algebra.loops import integers, kernel, plain
from impactlaw.stepping.compiled import libmujoco as mj

_extending: Any = extending
_called = _extending.register_jitable(_nrt=False, error_model="numpy", nogil=True)
"""Let compiled code call a function, each part of the rule, that Python calls, too."""
for _part in (hidden_edges.beyond, hidden_edges.depth_along, hidden_edges.hides):
    _called(_part)
support, moving_side = _called(hidden_edges.support), _called(hidden_edges.moving_side)
_hide = plain(hidden_edges.hide_edges)


@_extending.overload(hidden_edges.distance, strict=False)
def _distance(at: Any, one: Any, other: Any) -> Any:
    return lambda at, one, other: mj.geom_distance(at[0], at[1], one, other, APART, 0)


@kernel
def hide_edges(dist, pos, frame, geom, body_of_geom, weld, tree, shapes, at):
    """Do what `scene.corrected.hidden_edges.hide_edges` does."""
    room = integers(2 * len(body_of_geom) + len(dist))
    return _hide(dist, pos, frame, geom, body_of_geom, weld, tree, shapes, at, room)
