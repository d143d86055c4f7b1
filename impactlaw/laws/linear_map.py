"""A law given by a linear map of the generalized velocity instead of contact velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, Target, square_matrix
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, eq=False)
class LinearMap(Law):
    """``v+ = prox(h v-)``: the velocity nearest to ``h v-``, in the kinetic metric, that pushing contacts can reach.

    That is ``min |v+ - h v-|`` over ``v+ = v- + M^-1 J^T Lambda``, ``Lambda >= 0``, the set ``v- - T_C^perp`` of
    Aeberhard and Glocker, "Perfect multi-contact collisions" (``sigma_l(v-, h)``). Its target is ``gamma^h = J h v-``,
    in m/s, and it always has a solution.

    Attributes:
        h: the linear map, shape (nv, nv).

    Raises:
        RestitutionError: h is not a finite square matrix.
    """

    h: ArrayLike

    def __post_init__(self):
        object.__setattr__(self, "h", square_matrix(self.h, "linear map"))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = J u``, plus ``w+`` where surfaces move, and ``u = h v-``.

        Bilateral constraints keep their velocity: u is projected so that ``J_eq u = J_eq v-``.
        """
        h, v, metric = np.asarray(self.h), collision.pre_velocity, collision.metric
        if len(h) != len(v):
            raise RestitutionError(f"linear map is {h.shape} but the velocity has {len(v)} entries")
        u = h @ v
        if collision.bilateral_jacobian is not None:
            u = v + metric.unwhiten(collision._bilateral.project(metric.whiten(u - v)[None])[0])
        return Target(collision.contact_velocity_after(u), u)
