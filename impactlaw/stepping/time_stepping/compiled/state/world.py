"""One world in compiled code: its copy of the model for the step, its data, and the options of the scheme."""

from __future__ import annotations

from typing import NamedTuple

from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, inertia_of, layout_of, velocity_of
from impactlaw.stepping.compiled.fields import DATA, float_at
from impactlaw.stepping.compiled.whitening import Inertia


class Settings(NamedTuple):
    """Options of the scheme, as indices of an array of numbers."""

    rest_speed: int = 0  # least closing speed of a collision, m/s
    sliding: int = 1  # tangential restitution
    exact: int = 2  # 1 for exact Coulomb friction, 0 for its convex relaxation
    # what to do with energy that a law would create: 1 to scale restitution, 0 to allow it, -1 to stop
    dissipative: int = 3
    frictional: int = 4  # 1 if contacts have friction
    inertial: int = 5  # 1 if Coriolis or gyroscopic forces act
    sticks: int = 6  # 1 if bodies can stick across gaps
    forces: int = 7  # 1 if forces are written for the cones that the user has chosen
    restitution: int = 8  # e if it is the same for all contacts; else NaN
    reversal: int = 9  # e of a law that reverses contact velocities along the contacts' order; else NaN
    surfaces: int = 10  # whether mocap bodies move during a step, and meet other bodies, see `surfaces`; else 0
    sums: int = 11  # 1 if sums over collisions are asked for
    stands: int = 12  # 1 if cylinders can stand on planes
    listed: int = 13  # see `forces.listed_stage`
    meter: int = 14  # see `scene.tolerances.meter`
    beside: int = 15  # 1 if cylinders can touch side by side
    touching: int = 16  # gap, m or rad, up to which bodies at rest touch
    # 1 if the law is asked in Python, 2 if it is also shown the closed contacts that a collision reaches; else 0
    asks: int = 17
    rest_turn: int = 18  # least closing speed of a collision at limits of joints, m/s or rad/s


SETTING = Settings()


class World(NamedTuple):
    """One world, and results of a step about it."""

    model: int  # address of its model with the options and margins of the step
    data: int  # address of its data
    scratch: int  # address of other data, for looks at contacts that must not change data
    table: int  # address of offsets of fields, see `fields`
    settings: int  # address of `Settings`
    sizes: int  # address of what `margins.find_sizes` writes: sizes of bodies, m, then reaches of mocap bodies, m
    bilateral: int  # address of kinds of equality constraints, 0 if a collision may violate them, uint8 (neq,)
    nv: int  # degrees of freedom
    timestep: float  # h, s
    damped: bool  # whether the integrator damps implicitly
    surfaces: int  # address of the state of mocap bodies, see `surfaces`; 0 if they do not move during a step
    work: int  # address of the remaining part of the work allowed in the step, see `solvers.cones.budget.spend`
    python: int  # address of what is called in Python, see `hook.Hook`; 0 if nothing is


@plain
def setting(w, place):
    """Return one of `Settings`."""
    return float_at(w.settings + 8 * place)


@plain
def swap(one, other):
    """Exchange the numbers of two arrays."""
    for i in range(len(one)):
        one[i], other[i] = other[i], one[i]


@plain
def move_bodies(w, velocity):
    """Compute the velocities of bodies for a velocity, (nv,); that of data stays unchanged."""
    now = velocity_of(w)
    swap(now, velocity)
    mj.com_vel(w.model, w.data)
    swap(now, velocity)


@kernel
def metric_of(w):
    """Return the mass matrix of the step."""
    if w.damped:
        nnz, adr, col = layout_of(w)
        return Inertia(data_floats(w, DATA.qH, len(col)), data_floats(w, DATA.qHDiagInv, w.nv), nnz, adr, col)
    return inertia_of(w)
