"""MuJoCo's C functions for compiled code; pointers are numbers, int64."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any, TypeVar

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.fields import long_at

_Result = TypeVar("_Result")
_P, _I, _F = types.int64, types.int32, types.float64


@cache
def library() -> Any:
    """Return the library that MuJoCo's bindings have loaded."""
    return ctypes.CDLL(str(find_library(Path(mujoco.__file__).parent)))


def find_library(folder: Path) -> Path:
    """Return the library with the version of the bindings; a library of MuJoCo 4 may remain after going back to 3."""
    libraries = [path for path in folder.iterdir() if _is_library(path.name)]
    return max(libraries, key=lambda path: mujoco.mj_versionString() in path.name)


def _is_library(name: str) -> bool:
    return name.startswith(("libmujoco.", "mujoco.dll")) and any(end in name for end in (".so", ".dylib", ".dll"))


def _external(name: str, *arguments: Any, returned: Any = types.void) -> Any:
    """Return a C function for compiled code, given the types of its arguments."""
    llvm.add_symbol(name, ctypes.cast(getattr(library(), name), ctypes.c_void_p).value)
    return types.ExternalFunction(name, returned(*arguments))


def _of_worlds(*names: str) -> Iterator[Any]:
    """Return functions of a model and its data."""
    return (_external(name, _P, _P) for name in names)


kinematics, com_pos, com_vel = _of_worlds("mj_kinematics", "mj_comPos", "mj_comVel")
fwd_position, fwd_velocity = _of_worlds("mj_fwdPosition", "mj_fwdVelocity")
fwd_actuation, fwd_acceleration = _of_worlds("mj_fwdActuation", "mj_fwdAcceleration")
fwd_constraint, compare_fwd_inv, check_acc = _of_worlds("mj_fwdConstraint", "mj_compareFwdInv", "mj_checkAcc")
euler, implicit, whole_step, first_half = _of_worlds("mj_Euler", "mj_implicit", "mj_step", "mj_step1")
sensor_pos, sensor_vel, sensor_acc = _of_worlds("mj_sensorPos", "mj_sensorVel", "mj_sensorAcc")
make_m, factor_m, energy_pos, energy_vel = _of_worlds("mj_makeM", "mj_factorM", "mj_energyPos", "mj_energyVel")
tendon, collision = _of_worlds("mj_tendon", "mj_collision")
make_constraint, project_constraint = _of_worlds("mj_makeConstraint", "mj_projectConstraint")
reference_constraint, rne_post_constraint = _of_worlds("mj_referenceConstraint", "mj_rnePostConstraint")
runge_kutta = _external("mj_RungeKutta", _P, _P, _I)
rest_of_forward = _external("mj_forwardSkip", _P, _P, _I, _I)
tendon_bias, rne = _external("mj_tendonBias", _P, _P, _P), _external("mj_rne", _P, _P, _I, _P)
integrate_pos = _external("mj_integratePos", _P, _P, _P, _F)
mul_m, mul_jac_vec, mul_jac_t_vec = (
    _external(name, _P, _P, _P, _P) for name in ("mj_mulM", "mj_mulJacVec", "mj_mulJacTVec")
)
add_contact = _external("mj_addContact", _P, _P, _P, returned=_I)
geom_distance = _external("mj_geomDistance", _P, _P, _I, _I, _F, _P, returned=_F)
jac = _external("mj_jac", _P, _P, _P, _P, _P, _I)
sub_quat, rotate, mul_quat = (_external(name, _P, _P, _P) for name in ("mju_subQuat", "mju_rotVecQuat", "mju_mulQuat"))
axis_angle_to_quat = _external("mju_axisAngle2Quat", _P, _P, _F)
normalize4 = _external("mju_normalize4", _P, returned=types.float64)
get_state, set_state = (_external(name, _P, _P, _P, _I) for name in ("mj_getState", "mj_setState"))
apply_to_worlds = _external("mjb_apply", _P, _P, _I, _P, _P, _I, returned=_I)
is_sparse, make_data = _external("mj_isSparse", _P, returned=_I), _external("mj_makeData", _P, returned=_P)


CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")
"""Names of MuJoCo's callbacks that steps call."""
EXCHANGE = RLock()
"""Held while callbacks are exchanged: each thread must restore those of the user, not what another one has set."""


@cache
def callbacks() -> np.ndarray:
    """Return the addresses at which MuJoCo keeps its callbacks, int64."""
    places = [ctypes.addressof(ctypes.c_void_p.in_dll(library(), f"mjcb_{name}")) for name in CALLBACKS]
    return np.array(places, dtype=np.int64)


def is_called_back() -> bool:
    """Return whether any of MuJoCo's callbacks is set."""
    return any(ctypes.c_size_t.from_address(place).value for place in callbacks().tolist())


@cache
def _places() -> tuple[np.ndarray, np.ndarray]:
    """Return MuJoCo's memory that contains its callbacks, and their indices, so that numpy writes all of them at once.

    (They lie side by side.) Python can raise an interrupt between the assignments of a loop, but not within this one.
    """
    at = callbacks()
    first = int(at.min())
    memory: Any = (ctypes.c_size_t * ((int(at.max()) - first) // 8 + 1)).from_address(first)
    return np.frombuffer(memory, dtype=np.uintp), (at - first) // 8


def without_callbacks(call: Callable[[], _Result]) -> _Result:
    """Return what a function returns while MuJoCo's callbacks are off: they are for scenes of the user, not of ours.

    MuJoCo's compiler calls them, too. MuJoCo's bindings do not notice, and keep the functions of the user. This is no
    context manager, since an interrupt that arises where such a one ends would leave callbacks off.
    """
    with EXCHANGE:
        memory, at = _places()
        kept = memory[at]
        try:
            memory[at] = 0
            return call()
        finally:
            memory[at] = kept


@plain
def is_watched(places):
    """Return the result of `is_called_back`, in compiled code; see `callbacks`."""
    for i in range(len(places)):
        if long_at(places[i]) != 0:
            return True
    return False
