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
    """What the scheme has been told, as places in a row of numbers.

    Attributes:
        rest_speed: least closing speed of a collision, m/s or rad/s.
        sliding: tangential restitution.
        exact: 1 for exact Coulomb friction, 0 for its convex relaxation.
        dissipative: what is done with energy that a law would create: 1 to scale restitution, 0 to let it, -1 to stop.
        frictional: 1 where contacts have friction.
        inertial: 1 where Coriolis or gyroscopic forces act.
        sticks: 1 where something sticks across gaps.
        forces: 1 where forces are written as MuJoCo's own cones have them.
        restitution: e, where it is the same for all contacts; else NaN.
        reversal: e of a law that reverses contact velocities along the contacts' order; else NaN.
        surfaces: whether mocap bodies move through a step, and touch others: see `surfaces`; else 0.
        told: 1 where sums over collisions are asked for.
    """

    rest_speed: int = 0
    sliding: int = 1
    exact: int = 2
    dissipative: int = 3
    frictional: int = 4
    inertial: int = 5
    sticks: int = 6
    forces: int = 7
    restitution: int = 8
    reversal: int = 9
    surfaces: int = 10
    told: int = 11


SETTING = Settings()


class World(NamedTuple):
    """One world, and what a step has found out about it.

    Attributes:
        model: address of its model, whose options and margins are those of the step.
        data: address of its data.
        scratch: address of other data, for looks at contacts that data is not to show.
        table: address of offsets of fields, see `fields`.
        settings: address of `Settings`.
        sizes: address of `margins.find_sizes`, m, (nbody,), and then how far mocap bodies reach, m, (nmocap,).
        bilateral: address of which equality constraints a collision must not violate, uint8 (neq,).
        nv: degrees of freedom.
        timestep: h, s.
        damped: whether the integrator damps implicitly.
        surfaces: address of what is known of mocap bodies, see `surfaces`; 0 if they do not move through a step.
        work: address of the part of the work allowed in the step that is left, see `solvers.cones.hybrid.spend`.
    """

    model: int
    data: int
    scratch: int
    table: int
    settings: int
    sizes: int
    bilateral: int
    nv: int
    timestep: float
    damped: bool
    surfaces: int
    work: int


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
