"""The rows of a step: which of MuJoCo's take part, and reading them, see `problem.rows`."""

from __future__ import annotations

from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_floats,
    data_ints,
    layout_of_trees,
    number,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA
from impactlaw.stepping.compiled.left_out.tied_contacts import leave_tied_out
from impactlaw.stepping.time_stepping.compiled.impulses.passed_edges import (
    contacts_at,
    doubt_fast,
    geometry_of,
    look_ahead,
)
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surfaces_move
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.detection.fast_bodies import some_can_pass, take_back
from impactlaw.stepping.time_stepping.problem.detection.floor_edges import leave_edges
from impactlaw.stepping.time_stepping.problem.rows import (
    JACOBIAN,
    Source,
    count_groups,
    find_near,
    write_rows,
)


@plain
def near(w, jacobian, one, other, reach, found):
    """Write which rows begin a contact or limit that is closed or would soon be, (nefc,); see `rows.find_near`."""
    n = number(w, DATA.nefc)
    if surfaces_move(w):  # surfaces come near to bodies that do not move
        found[:] = True
    else:
        kinds, position = data_ints(w, DATA.efc_type, n), data_floats(w, DATA.efc_pos, n)
        address = contact_ints(w, CONTACT.efc_address, 1)[:, 0]
        find_near(kinds, position, jacobian, address, one, other, reach, found)
    leave_tied_out(w, jacobian, found)


@plain
def count(w, chosen, frictional):
    """Return the number of chosen groups, and the number of their rows; see `rows.count_groups`."""
    n, dim = number(w, DATA.nefc), contact_ints(w, CONTACT.dim, 1)[:, 0]
    kinds, number_of = data_ints(w, DATA.efc_type, n), data_ints(w, DATA.efc_id, n)
    return count_groups(kinds, number_of, dim, contact_floats(w, CONTACT.friction, 5), chosen, frictional)


@plain
def read(w, jacobian, metric, velocity, start, free, chosen, frictional, mark, room, rows):
    """Write the rows of the chosen groups, and return the number of their entries; see `rows.write_rows`.

    Args:
        w: the world with current contacts.
        jacobian: `access.jacobian_of`, without zeros.
        metric: the mass matrix of the step.
        velocity: velocities of MuJoCo's rows, including belts, (nefc,); (0,) to leave belts out.
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        chosen: chosen rows of MuJoCo's, bool (nefc,).
        frictional: whether rows of friction take part.
        mark: marks of trees, False.
        room: scratch space, (2 nv,).
        rows: written.
    """
    n = number(w, DATA.nefc)
    source = Source(
        data_ints(w, DATA.efc_type, n), data_ints(w, DATA.efc_id, n), data_floats(w, DATA.efc_pos, n), velocity,
        data_floats(w, DATA.efc_aref, n), data_floats(w, DATA.efc_R, n), data_floats(w, DATA.efc_frictionloss, n),
        jacobian, contact_ints(w, CONTACT.dim, 1)[:, 0], contact_ints(w, CONTACT.geom, 2),
        contact_floats(w, CONTACT.friction, 5),
    )  # fmt: skip
    trees, touching = layout_of_trees(w), setting(w, SETTING.touching)
    return write_rows(source, metric, trees, start, free, chosen, w.timestep, frictional, touching, mark, room, rows)


@linked(types.void(WORLD, JACOBIAN, NUMBERS, BOOLEAN, *[MARKS] * 3), counts=False)
def look(w, jacobian, middle, doubts, chosen, seen, doubtful):
    """Write which rows the velocity of data closes, (nefc,); for the arguments see `choose`, which returns `doubts`."""
    near(w, jacobian, velocity_of(w), velocity_of(w), w.timestep, seen)
    if doubts:
        look_ahead(w, jacobian, middle, chosen, seen, doubtful)


@linked(BOOLEAN(WORLD, JACOBIAN, *[NUMBERS] * 3, *[MARKS] * 3), counts=False)
def choose(w, jacobian, start, free, middle, chosen, seen, doubtful):
    """Write which of MuJoCo's rows take part at first, (nefc,); return whether contacts are left out as doubtful.

    Contacts that are far from closing are left out, and those that bodies may pass over, see `passed_edges`.

    Args:
        w: the world in the middle of the step; qvel is the velocity without contact.
        jacobian: `access.jacobian_of`.
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        middle: position in the middle of the step, (nq,).
        chosen: written.
        seen: scratch space, bool (nefc,).
        doubtful: contacts that bodies may pass over, False, (ncon,), written.
    """
    near(w, jacobian, start, free, 2.0 * w.timestep, chosen)
    passes = some_can_pass(contacts_at(w), geometry_of(w)[0], chosen)
    doubts = passes and doubt_fast(w, start, chosen, doubtful)
    if doubts:
        look(w, jacobian, middle, doubts, chosen, seen, doubtful)
        take_back(contacts_at(w), chosen, seen, doubtful)
    return (passes and leave_edges(contacts_at(w), geometry_of(w), chosen, doubtful)) or doubts
