"""One world in compiled code: a model of its own for the step, its data, and what the scheme has been told."""

from __future__ import annotations

from typing import NamedTuple

from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.stepping.compiled.access import data_floats, size
from impactlaw.stepping.compiled.fields import (
    DATA,
    MODEL,
    float_at,
)


class Settings(NamedTuple):
    """What the scheme has been told, as places in a row of numbers."""

    rest_speed: int = 0  # least closing speed of a collision, m/s or rad/s
    sliding: int = 1  # tangential restitution
    exact: int = 2  # 1 for exact Coulomb friction, 0 for its convex relaxation
    # what is done with energy that a law would create: 1 to scale restitution, 0 to let it, -1 to stop
    dissipative: int = 3
    frictional: int = 4  # 1 where contacts have friction
    inertial: int = 5  # 1 where Coriolis or gyroscopic forces act
    sticks: int = 6  # 1 where something sticks across gaps
    forces: int = 7  # 1 where forces are written as MuJoCo's own cones have them
    restitution: int = 8  # e, where it is the same for all contacts; else NaN
    reversal: int = 9  # e of a law that reverses contact velocities along the contacts' order; else NaN
    surfaces: int = 10  # whether mocap bodies move through a step, and touch others: see `surfaces`; else 0
    told: int = 11  # 1 where sums over collisions are asked for


SETTING = Settings()


class World(NamedTuple):
    """One world, and what a step has found out about it."""

    model: int  # address of its model, whose options and margins are those of the step
    data: int  # address of its data
    scratch: int  # address of other data, for looks at contacts that data is not to show
    table: int  # address of offsets of fields, see `fields`
    settings: int  # address of `Settings`
    sizes: int  # address of `margins.find_sizes`, m, (nbody,), and then how far mocap bodies reach, m, (nmocap,)
    bilateral: int  # address of which equality constraints a collision must not violate, uint8 (neq,)
    nv: int  # degrees of freedom
    timestep: float  # h, s
    damped: bool  # whether the integrator damps implicitly
    surfaces: int  # address of what is known of mocap bodies, see `surfaces`; 0 if they do not move through a step
    work: int  # address of the part of the work allowed in the step that is left, see `solvers.cones.budget.spend`


@plain
def setting(w, place):
    """Return one of `Settings`."""
    return float_at(w.settings + 8 * place)


@kernel
def metric_of(w):
    """Return L and ``1 / D`` of the mass matrix of the step."""
    entries = size(w, MODEL.nC)
    if w.damped:
        return data_floats(w, DATA.qH, entries), data_floats(w, DATA.qHDiagInv, w.nv)
    return data_floats(w, DATA.qLD, entries), data_floats(w, DATA.qLDiagInv, w.nv)
