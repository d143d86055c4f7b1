"""Offsets of the fields of MuJoCo's structures, read from `mujoco.introspect` and passed to compiled code as numbers.

The numbers are arguments of compiled code, not parts of it, so that the cache on disk holds for any MuJoCo.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import UncompilableError
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, SIZE
from impactlaw.stepping.compiled.libmujoco import without_callbacks

_NUMBERS: dict[str, Any] = {
    "mjtNum": ctypes.c_double,
    "int": ctypes.c_int,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "mjtBool": ctypes.c_uint8,
    "mjtByte": ctypes.c_uint8,
    "float": ctypes.c_float,
    "char": ctypes.c_char,
    "unsigned char": ctypes.c_uint8,
    "unsigned int": ctypes.c_uint,
}
_INNER = {"opt": "mjOption", "stat": "mjStatistic"}
"""Structures inside mjModel; the names of their fields have the structure's name in front."""


def _type(declared: Any, known: dict[str, Any]) -> Any:
    """Return a declared type as a type of ctypes."""
    from mujoco.introspect import ast_nodes

    if isinstance(declared, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(declared, ast_nodes.ArrayType):
        found = _type(declared.inner_type, known)
        for extent in reversed(declared.extents):
            found = found * extent
        return found
    if isinstance(declared, (ast_nodes.AnonymousStructDecl, ast_nodes.AnonymousUnionDecl)):
        return _structure(declared.fields, known, union=isinstance(declared, ast_nodes.AnonymousUnionDecl))
    name = declared.name
    if name in _NUMBERS:
        return _NUMBERS[name]
    return ctypes.c_int if name.startswith("mjt") else _named(name, known)


def _structure(fields: Any, known: dict[str, Any], *, union: bool = False) -> Any:
    base = ctypes.Union if union else ctypes.Structure
    named = [field for field in fields if hasattr(field, "name")]
    return type("Found", (base,), {"_fields_": [(field.name, _type(field.type, known)) for field in named]})


def _named(name: str, known: dict[str, Any]) -> Any:
    from mujoco.introspect import structs

    name = name.removeprefix("struct ").removesuffix("_")
    if name not in known:
        known[name] = _structure(structs.STRUCTS[name].fields, known)
    return known[name]


@cache
def table() -> np.ndarray:
    """Return the offsets of all fields in `fields`, in order, and the sizes of structures, bytes, int64."""
    known: dict[str, Any] = {}
    model, data, contact = (_named(name, known) for name in ("mjModel", "mjData", "mjContact"))
    offsets = [getattr(data, name).offset for name in DATA._fields]
    for name in MODEL._fields:
        outer, _, inner = name.partition("_")
        if outer in _INNER:
            offsets.append(getattr(model, outer).offset + getattr(_named(_INNER[outer], known), inner).offset)
        else:
            offsets.append(getattr(model, name).offset)
    offsets += [getattr(contact, name).offset for name in CONTACT._fields]
    offsets += [ctypes.sizeof(model), ctypes.sizeof(contact)]
    found = np.array(offsets, dtype=np.int64)
    _check(found)
    return found


def structure_at(owner: Any) -> int:
    """Return the address of MuJoCo's structure of a model or of data."""
    return owner._address


@cache
def data_offset(name: str) -> int:
    """Return the offset of an array's address in mjData, bytes.

    The offset is negative if the array itself is in mjData.
    """
    data = _named("mjData", {})
    offset = getattr(data, name).offset
    return offset if dict(data._fields_)[name] is ctypes.c_void_p else -offset


_SCENE = (
    '<mujoco><worldbody><geom size="1"/><body pos="0 0 1.9"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
)


def _touching_balls() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _check(offsets: np.ndarray) -> None:
    """Compare addresses with those of MuJoCo's bindings."""
    model, data = without_callbacks(_touching_balls)
    pointers = [(structure_at(data), DATA, data), (structure_at(model), MODEL, model)]
    wrong = []
    for address, fields, owner in pointers:
        for name, index in zip(fields._fields, fields, strict=True):
            array = getattr(owner, name, None)
            if not isinstance(array, np.ndarray) or not array.size:
                continue
            seen = ctypes.c_void_p.from_address(address + int(offsets[index])).value
            if seen != array.ctypes.data:
                wrong.append(name)
    contact = data.contact[0]
    at = ctypes.c_void_p.from_address(data._address + int(offsets[DATA.contact])).value or 0
    if ctypes.c_double.from_address(at + int(offsets[CONTACT.dist])).value != contact.dist:
        wrong.append("contact.dist")
    if ctypes.c_double.from_address(model._address + int(offsets[MODEL.opt_timestep])).value != model.opt.timestep:
        wrong.append("opt.timestep")
    if int(offsets[SIZE.contact]) * data.ncon != data.contact.dist.strides[0] * data.ncon:
        wrong.append("mjContact")
    if wrong:
        raise UncompilableError(f"MuJoCo {mujoco.__version__} keeps {', '.join(wrong)} elsewhere than it says")


def empty_stack(data: Any) -> None:
    """Empty MuJoCo's stack, which an error of MuJoCo leaves in use."""
    for place in (DATA.pstack, DATA.pbase):
        ctypes.c_size_t.from_address(data._address + int(table()[place])).value = 0
