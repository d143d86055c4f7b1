"""MuJoCo's C functions for compiled code; pointers are numbers, int64."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.fields import long_at

_P, _I, _F = types.int64, types.int32, types.float64
_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "mj_kinematics": (_P, _P),
    "mj_comPos": (_P, _P),
    "mj_comVel": (_P, _P),
    "mj_fwdPosition": (_P, _P),
    "mj_fwdVelocity": (_P, _P),
    "mj_fwdActuation": (_P, _P),
    "mj_fwdAcceleration": (_P, _P),
    "mj_Euler": (_P, _P),
    "mj_implicit": (_P, _P),
    "mj_sensorPos": (_P, _P),
    "mj_sensorVel": (_P, _P),
    "mj_sensorAcc": (_P, _P),
    "mj_makeM": (_P, _P),
    "mj_energyPos": (_P, _P),
    "mj_energyVel": (_P, _P),
    "mj_tendon": (_P, _P),
    "mj_tendonBias": (_P, _P, _P),
    "mj_collision": (_P, _P),
    "mj_makeConstraint": (_P, _P),
    "mj_referenceConstraint": (_P, _P),
    "mj_integratePos": (_P, _P, _P, _F),
    "mj_rne": (_P, _P, _I, _P),
    "mj_rnePostConstraint": (_P, _P),
    "mj_mulM": (_P, _P, _P, _P),
    "mj_mulJacTVec": (_P, _P, _P, _P),
    "mj_jac": (_P, _P, _P, _P, _P, _I),
    "mj_step": (_P, _P),
    "mj_step1": (_P, _P),
    "mj_forwardSkip": (_P, _P, _I, _I),
    "mj_checkAcc": (_P, _P),
    "mj_compareFwdInv": (_P, _P),
    "mj_RungeKutta": (_P, _P, _I),
    "mj_fwdConstraint": (_P, _P),
    "mj_mulJacVec": (_P, _P, _P, _P),
    "mju_subQuat": (_P, _P, _P),
    "mju_rotVecQuat": (_P, _P, _P),
    "mju_axisAngle2Quat": (_P, _P, _F),
    "mju_mulQuat": (_P, _P, _P),
    "mju_normalize4": (_P,),
    "mj_isSparse": (_P,),
    "mj_makeData": (_P,),
    "mj_getState": (_P, _P, _P, _I),
    "mj_setState": (_P, _P, _P, _I),
}


@cache
def library() -> Any:
    """Return the library that MuJoCo's bindings have loaded."""
    return ctypes.CDLL(str(find_library(Path(mujoco.__file__).parent)))


def add_tendon_bias(model: mujoco.MjModel, data: mujoco.MjData, bias: np.ndarray) -> None:
    """Add the forces of turning tendons with inertia to a bias, (nv,); MuJoCo's bindings lack this function."""
    library().mj_tendonBias(*map(ctypes.c_void_p, (model._address, data._address, bias.ctypes.data)))


def find_library(folder: Path) -> Path:
    """Return the library with the version of the bindings; a library of MuJoCo 4 may remain after going back to 3."""
    libraries = [path for path in folder.iterdir() if _is_library(path.name)]
    return max(libraries, key=lambda path: mujoco.mj_versionString() in path.name)


def _is_library(name: str) -> bool:
    return name.startswith(("libmujoco.", "mujoco.dll")) and any(end in name for end in (".so", ".dylib", ".dll"))


def _external(name: str, returned: Any = types.void) -> Any:
    llvm.add_symbol(name, ctypes.cast(getattr(library(), name), ctypes.c_void_p).value)
    return types.ExternalFunction(name, returned(*_FUNCTIONS[name]))


kinematics, com_pos, com_vel = (_external(name) for name in ("mj_kinematics", "mj_comPos", "mj_comVel"))
fwd_position, fwd_velocity = _external("mj_fwdPosition"), _external("mj_fwdVelocity")
fwd_actuation, fwd_acceleration = _external("mj_fwdActuation"), _external("mj_fwdAcceleration")
euler, implicit = _external("mj_Euler"), _external("mj_implicit")
sensor_pos, sensor_vel, sensor_acc = (_external(name) for name in ("mj_sensorPos", "mj_sensorVel", "mj_sensorAcc"))
make_m, energy_pos, energy_vel = (_external(name) for name in ("mj_makeM", "mj_energyPos", "mj_energyVel"))
tendon, collision, make_constraint = (_external(n) for n in ("mj_tendon", "mj_collision", "mj_makeConstraint"))
tendon_bias, reference_constraint = _external("mj_tendonBias"), _external("mj_referenceConstraint")
integrate_pos, rne, mul_m = (_external(name) for name in ("mj_integratePos", "mj_rne", "mj_mulM"))
mul_jac_t_vec, rne_post_constraint = _external("mj_mulJacTVec"), _external("mj_rnePostConstraint")
whole_step, first_half, rest_of_forward = (_external(name) for name in ("mj_step", "mj_step1", "mj_forwardSkip"))
check_acc, compare_fwd_inv = _external("mj_checkAcc"), _external("mj_compareFwdInv")
runge_kutta, fwd_constraint, mul_jac_vec = (
    _external(name) for name in ("mj_RungeKutta", "mj_fwdConstraint", "mj_mulJacVec")
)
jac = _external("mj_jac")
sub_quat, rotate = _external("mju_subQuat"), _external("mju_rotVecQuat")
axis_angle_to_quat, mul_quat = _external("mju_axisAngle2Quat"), _external("mju_mulQuat")
normalize4 = _external("mju_normalize4", types.float64)
get_state, set_state = _external("mj_getState"), _external("mj_setState")
is_sparse, make_data = _external("mj_isSparse", types.int32), _external("mj_makeData", types.int64)


_CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")


@cache
def callbacks() -> np.ndarray:
    """Return the addresses at which MuJoCo keeps its callbacks, int64."""
    places = [ctypes.addressof(ctypes.c_void_p.in_dll(library(), f"mjcb_{name}")) for name in _CALLBACKS]
    return np.array(places, dtype=np.int64)


def is_called_back() -> bool:
    """Return whether any of MuJoCo's callbacks is set."""
    return any(ctypes.c_size_t.from_address(place).value for place in callbacks().tolist())


@contextmanager
def without_callbacks() -> Iterator[None]:
    """Disable MuJoCo's callbacks meanwhile: they are for the scene of the user, not for scenes of this package.

    MuJoCo's compiler calls them, too. Callbacks set from C are unknown to MuJoCo's bindings, which therefore do not
    restore them.
    """
    places = [ctypes.c_size_t.from_address(place) for place in callbacks().tolist()]
    addresses = [place.value for place in places]
    functions = [getattr(mujoco, f"get_mjcb_{name}")() for name in _CALLBACKS]
    try:
        for name in _CALLBACKS:
            getattr(mujoco, f"set_mjcb_{name}")(None)
        yield
    finally:
        for name, function, place, address in zip(_CALLBACKS, functions, places, addresses, strict=True):
            getattr(mujoco, f"set_mjcb_{name}")(function)
            place.value = address


@plain
def is_watched(places):
    """Return the result of `is_called_back`, in compiled code; see `callbacks`."""
    for i in range(len(places)):
        if long_at(places[i]) != 0:
            return True
    return False
