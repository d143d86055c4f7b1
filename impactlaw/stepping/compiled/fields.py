"""Fields of MuJoCo's structures in compiled code, by addresses and offsets given as numbers, int64."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, cast

import numba
from numba import extending, types

from impactlaw.solvers.cones.algebra.loops import kernel

_intrinsic: Any = extending.intrinsic
carray: Any = cast(Any, numba).carray

_Data = namedtuple(
    "_Data",
    "time nefc ncon ne nf nl nJ maxuse_efc pstack pbase warning flg_subtreevel flg_rnepost flg_energypos "
    "flg_energyvel qpos qvel eq_active "
    "mocap_pos mocap_quat qacc act_dot qacc_smooth qacc_warmstart qfrc_applied qfrc_constraint qfrc_smooth qfrc_bias "
    "cvel cdof_dot xipos subtree_com geom_xpos geom_xmat M qLD qLDiagInv qH qHDiagInv contact efc_type efc_id efc_pos "
    "efc_margin efc_KBIP efc_vel efc_aref efc_R efc_frictionloss efc_force efc_J efc_J_rownnz efc_J_rowadr "
    "efc_J_colind",
)
"""Indices of fields of mjData in the table of offsets."""

_Model = namedtuple(
    "_Model",
    "nq nv na nactuator nbody njnt ngeom npair nflex ntendon ntree neq nmocap nC nplugin nhistory nsensordata "
    "flg_adhesion actuator_trntype body_margin geom_margin geom_gap pair_margin pair_gap jnt_margin tendon_margin "
    "tendon_range tendon_adr wrap_type "
    "geom_bodyid geom_type geom_pos geom_rbound geom_size geom_aabb body_ipos body_pos body_parentid body_dofadr "
    "body_dofnum body_rootid body_treeid body_weldid body_mocapid M_rownnz M_rowadr M_colind dof_treeid dof_bodyid "
    "dof_M0 dof_invweight0 dof_simplenum body_subtreemass tree_dofadr tree_dofnum dof_damping dof_dampingpoly "
    "jnt_actuatorid jnt_type jnt_limited jnt_qposadr jnt_dofadr jnt_range opt_timestep opt_gravity opt_integrator "
    "opt_cone opt_solver opt_noslip_iterations opt_disableflags opt_enableflags stat_meansize",
)
"""Indices of fields of mjModel in the table of offsets; opt_ and stat_ are fields of mjOption and mjStatistic."""

_Contact = namedtuple("_Contact", "dist pos frame includemargin dim geom friction exclude efc_address")
"""Indices of fields of mjContact in the table of offsets."""

_Size = namedtuple("_Size", "model contact")
"""Indices of sizes of structures in the table, bytes."""


def _places(kind: Any, first: int) -> Any:
    return kind(*range(first, first + len(kind._fields)))


DATA: _Data = _places(_Data, 0)
MODEL: _Model = _places(_Model, len(DATA))
CONTACT: _Contact = _places(_Contact, len(DATA) + len(MODEL))
SIZE: _Size = _places(_Size, len(DATA) + len(MODEL) + len(CONTACT))


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


def _arrays(kind: Any) -> Any:
    """Return a compiled function that returns the numbers of a kind at an address, (n,) or a table of a given shape."""
    pointer = _pointer(kind)

    @kernel
    def at(address, shape):
        return carray(pointer(address), shape)

    return at


floats, ints, longs, flags, bools = (
    _arrays(kind) for kind in (types.float64, types.int32, types.int64, types.uint8, types.boolean)
)
float_at, int_at, long_at = (_reader(kind) for kind in (types.float64, types.int32, types.int64))
put_int, put_long = (_writer(kind) for kind in (types.int32, types.int64))


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
