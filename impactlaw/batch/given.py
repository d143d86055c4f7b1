"""Check the arguments of a batch: numbers of worlds, keyframes and laws. On bad ones MuJoCo would end the process."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlaw.errors import OptionError, SceneError, UnknownNameError
from impactlaw.laws import Law
from impactlaw.stepping.compiled.libmujoco import is_called_back


def world_numbers(ids: Sequence[int] | None, count: int, *, ascending: bool = True) -> np.ndarray:
    """Return checked numbers of worlds, int32 (k,): all of them if ids is None.

    Args:
        ids: the numbers.
        count: how many worlds there are.
        ascending: whether the numbers must ascend; if not, each must only occur once.

    Raises:
        OptionError: ids are not such numbers.
    """
    if ids is None:
        return np.arange(count, dtype=np.int32)
    worlds = np.asarray(ids)
    if worlds.size == 0:
        return np.zeros(0, np.int32)
    whole = worlds.ndim == 1 and worlds.dtype.kind in "iu"
    there = whole and worlds.min() >= 0 and worlds.max() < count
    order = worlds if ascending or not there else np.sort(worlds)
    if not there or (order[1:] <= order[:-1]).any():
        how = ", ascending and each once" if ascending else ", each once"
        raise OptionError(f"ids are numbers of worlds from 0 to {count - 1}{how}, got {ids!r:.100}")
    return worlds.astype(np.int32)


def keyframes(keyframe: int | Sequence[int], worlds: int, count: int) -> np.ndarray:
    """Return one keyframe per world, int32 (worlds,), -1 for the initial state; the model has `count` keyframes."""
    keys = np.asarray(keyframe)
    whole = keys.dtype.kind in "iu" and keys.shape in ((), (worlds,))
    if not whole or not ((keys >= -1) & (keys < count)).all():
        raise OptionError(
            f"keyframe is a number from -1, the start, to {count - 1}, or one for each of {worlds} worlds, got "
            f"{keyframe!r:.100}"
        )
    return np.ascontiguousarray(np.broadcast_to(keys.astype(np.int32), (worlds,)))


def check_name(name: object) -> None:
    """Raise UnknownNameError unless the name of a field is a string."""
    if not isinstance(name, str):
        raise UnknownNameError("field", name, ('a name as text, such as "qpos"',))


def one_each(law: Any, count: int) -> list[Law]:
    """Return a list of one law per world, from one law for all worlds or a sequence of laws."""
    laws: Any = law
    if isinstance(law, Law | str) or not isinstance(law, Sequence):
        laws = [law] * count
    if len(laws) != count:
        raise SceneError(f"{count} worlds need as many laws, got {len(laws)}")
    for own in laws:
        if not isinstance(own, Law):
            raise UnknownNameError("law of a batch", own, ('a Law, such as impactlaw.make_law("moreau", 0.5)',))
    return list(laws)


def check_threads(nthread: object) -> None:
    """Raise OptionError unless nthread is a nonnegative integer."""
    if not isinstance(nthread, numbers.Integral) or nthread < 0:
        raise OptionError(f"nthread is a whole number of threads, or 0 for one per processor, got {nthread!r}")


def check_callbacks() -> None:
    """Raise SceneError if a callback of MuJoCo is set.

    Rigid steps of a batch would not call some callbacks, and other functions would call them from several threads.
    """
    if is_called_back():
        raise SceneError(
            "a callback of MuJoCo is set (mjcb_control or another one), which a batch cannot call; take it off, or use "
            "Stepper"
        )
