"""What a batch is given: numbers of worlds, keyframes and laws, refused here where MuJoCo would end the process."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlaw.errors import OptionError, SceneError, UnknownNameError
from impactlaw.laws import Law
from impactlaw.stepping.compiled.libmujoco import is_called_back


def world_numbers(ids: Sequence[int] | None, count: int, *, ascending: bool = True) -> np.ndarray:
    """Return the numbers of some worlds of so many, or of all if None, int32 (k,)."""
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
    """Return a keyframe for each of so many worlds, -1 for the start, int32 (worlds,)."""
    keys = np.asarray(keyframe)
    whole = keys.dtype.kind in "iu" and keys.shape in ((), (worlds,))
    if not whole or not ((keys >= -1) & (keys < count)).all():
        raise OptionError(
            f"keyframe is a number from -1, the start, to {count - 1}, or one for each of {worlds} worlds, got "
            f"{keyframe!r:.100}"
        )
    return np.ascontiguousarray(np.broadcast_to(keys.astype(np.int32), (worlds,)))


def check_name(name: object) -> None:
    """Refuse what cannot be the name of a field."""
    if not isinstance(name, str):
        raise UnknownNameError("field", name, ('a name as text, such as "qpos"',))


def one_each(law: Any, count: int) -> list[Law]:
    """Return one law for each of so many worlds."""
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
    """Refuse what is no number of threads."""
    if not isinstance(nthread, numbers.Integral) or nthread < 0:
        raise OptionError(f"nthread is a whole number of threads, or 0 for one per processor, got {nthread!r}")


def check_callbacks() -> None:
    """Refuse callbacks of MuJoCo: rigid steps of a batch leave some out, and all else would call them in threads."""
    if is_called_back():
        raise SceneError(
            "a callback of MuJoCo is set (mjcb_control or another one), which a batch cannot call; take it off, or use "
            "Stepper"
        )
