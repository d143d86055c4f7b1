"""Fields of MuJoCo's structures in compiled code, by addresses and offsets given as numbers, int64."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import extending, types

from impactlaw.solvers.cones.algebra.loops import kernel

_intrinsic: Any = extending.intrinsic
carray: Any = cast(Any, numba).carray


class _Data(NamedTuple):
    """Indices of fields of mjData in the table of offsets."""

    time: int
    nefc: int
    ncon: int
    ne: int
    nf: int
    nl: int
    nJ: int
    maxuse_efc: int
    pstack: int
    pbase: int
    warning: int
    flg_subtreevel: int
    flg_rnepost: int
    qpos: int
    qvel: int
    eq_active: int
    mocap_pos: int
    mocap_quat: int
    qacc: int
    act_dot: int
    qacc_smooth: int
    qacc_warmstart: int
    qfrc_constraint: int
    qfrc_smooth: int
    qfrc_bias: int
    cvel: int
    xipos: int
    subtree_com: int
    M: int
    qLD: int
    qLDiagInv: int
    qH: int
    qHDiagInv: int
    contact: int
    efc_type: int
    efc_id: int
    efc_pos: int
    efc_margin: int
    efc_KBIP: int
    efc_vel: int
    efc_aref: int
    efc_R: int
    efc_frictionloss: int
    efc_force: int
    efc_J: int
    efc_J_rownnz: int
    efc_J_rowadr: int
    efc_J_colind: int


class _Model(NamedTuple):
    """Indices of fields of mjModel in the table of offsets; opt_ and stat_ are fields of mjOption and mjStatistic."""

    nq: int
    nv: int
    na: int
    nbody: int
    njnt: int
    ngeom: int
    npair: int
    ntendon: int
    ntree: int
    neq: int
    nmocap: int
    nC: int
    nplugin: int
    nhistory: int
    nsensordata: int
    body_margin: int
    geom_margin: int
    geom_gap: int
    pair_margin: int
    pair_gap: int
    jnt_margin: int
    tendon_margin: int
    geom_bodyid: int
    geom_type: int
    geom_pos: int
    geom_rbound: int
    body_ipos: int
    body_pos: int
    body_parentid: int
    body_rootid: int
    body_treeid: int
    body_weldid: int
    body_mocapid: int
    M_rownnz: int
    M_rowadr: int
    M_colind: int
    dof_treeid: int
    dof_bodyid: int
    dof_M0: int
    body_subtreemass: int
    tree_dofadr: int
    tree_dofnum: int
    dof_damping: int
    dof_dampingpoly: int
    jnt_actuatorid: int
    jnt_type: int
    jnt_limited: int
    jnt_qposadr: int
    jnt_dofadr: int
    jnt_range: int
    opt_timestep: int
    opt_gravity: int
    opt_integrator: int
    opt_cone: int
    opt_solver: int
    opt_noslip_iterations: int
    opt_disableflags: int
    opt_enableflags: int
    stat_meansize: int


class _Contact(NamedTuple):
    """Indices of fields of mjContact in the table of offsets."""

    dist: int
    pos: int
    frame: int
    dim: int
    geom: int
    friction: int
    exclude: int
    efc_address: int


class _Size(NamedTuple):
    """Indices of sizes of structures in the table, bytes."""

    model: int
    contact: int


def _places(kind: Any, first: int) -> Any:
    return kind(*range(first, first + len(kind._fields)))


DATA: _Data = _places(_Data, 0)
MODEL: _Model = _places(_Model, len(DATA))
CONTACT: _Contact = _places(_Contact, len(DATA) + len(MODEL))
SIZE: _Size = _places(_Size, len(DATA) + len(MODEL) + len(CONTACT))
ALL = len(DATA) + len(MODEL) + len(CONTACT) + len(SIZE)
"""Number of entries of the table."""


def _pointer(kind: Any) -> Any:
    """Return a compiled function that turns an address into a pointer to numbers of a kind."""

    @_intrinsic
    def of(typingctx: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(types.CPointer(kind)))

        return types.CPointer(kind)(types.int64), generate

    return of


def _reader(kind: Any) -> Any:
    """Return a compiled function that returns the number of a kind at an address."""

    @_intrinsic
    def read(typingctx: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load(builder.inttoptr(values[0], context.get_value_type(types.CPointer(kind))))

        return kind(types.int64), generate

    return read


def _writer(kind: Any) -> Any:
    """Return a compiled function that writes a number of a kind at an address."""

    @_intrinsic
    def write(typingctx: Any, address: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            builder.store(values[1], builder.inttoptr(values[0], context.get_value_type(types.CPointer(kind))))
            return context.get_dummy_value()

        return types.void(types.int64, kind), generate

    return write


_double, _int, _long, _byte, _bool = (
    _pointer(kind) for kind in (types.float64, types.int32, types.int64, types.uint8, types.boolean)
)
float_at, int_at, long_at = (_reader(kind) for kind in (types.float64, types.int32, types.int64))
put_int, put_long = (_writer(kind) for kind in (types.int32, types.int64))


@kernel
def floats(address, n):
    """Return n doubles at an address."""
    return carray(_double(address), n)


@kernel
def ints(address, n):
    """Return n ints at an address."""
    return carray(_int(address), n)


@kernel
def longs(address, n):
    """Return n 64-bit integers at an address."""
    return carray(_long(address), n)


@kernel
def flags(address, n):
    """Return n bytes at an address."""
    return carray(_byte(address), n)


@kernel
def bools(address, n):
    """Return n booleans at an address."""
    return carray(_bool(address), n)


@kernel
def table_floats(address, rows, columns):
    """Return a table of doubles at an address."""
    return carray(_double(address), (rows, columns))


@kernel
def table_ints(address, rows, columns):
    """Return a table of ints at an address."""
    return carray(_int(address), (rows, columns))


@_intrinsic
def keep(typingctx: Any, array: Any) -> Any:
    """Do nothing; keeps an array alive up to here while its address is in use."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return context.get_dummy_value()

    return types.void(array), generate


@_intrinsic
def claim(typingctx: Any, address: Any, value: Any) -> Any:
    """Write a 64-bit integer to an address if it holds 0, atomically, and return what it held."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = builder.inttoptr(values[0], context.get_value_type(types.CPointer(types.int64)))
        nothing = context.get_constant(types.int64, 0)
        return builder.extract_value(builder.cmpxchg(place, nothing, values[1], "seq_cst", "seq_cst"), 0)

    return types.int64(types.int64, types.int64), generate


@_intrinsic
def address_of(typingctx: Any, array: Any) -> Any:
    """Return the address of an array."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        found = context.make_array(signature.args[0])(context, builder, values[0])
        return builder.ptrtoint(found.data, context.get_value_type(types.int64))

    return types.int64(array), generate
