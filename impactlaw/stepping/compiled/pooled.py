"""Shared parts of entries for many worlds in MuJoCo's pool: other data of each thread, and fields to copy out."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, claim, flags, long_at, longs


@plain
def other_data(model, data, slots):
    """Return the other data of the thread that owns this data; it is made on first use.

    Args:
        model: address of the model.
        data: address of the thread's data.
        slots: pairs of data and other data, initially zero, int64 (2 k,), written.
    """
    for i in range(len(slots) // 2):
        slot = address_of(slots) + 16 * i
        owner = long_at(slot)
        if owner == 0:
            owner = claim(slot, data)
            if owner == 0:
                slots[2 * i + 1] = mj.make_data(model)
                owner = data
        if owner == data:
            return slots[2 * i + 1]
    return 0


@plain
def copy_out(data, world, outputs, count):
    """Copy fields of data into the arrays of all worlds.

    Args:
        data: address of the data of a world.
        world: index of the world.
        outputs: address of three numbers for each field: the offset of its address in data (negative if the field
            itself is there), the address of the output of world 0, and the size in bytes.
        count: number of fields.
    """
    for i in range(count):
        output = longs(outputs + 24 * i, 3)
        at, size = output[0], output[2]
        source = long_at(data + at) if at >= 0 else data - at
        put(flags(output[1] + size * world, size), flags(source, size))
