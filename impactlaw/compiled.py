"""Compilation of functions by numba, with a cache on disk that is valid for exactly one version of the code.

To decide whether a cached function is still valid, numba checks only the file of the function, not the files of the
functions that it calls. The cache is therefore in a folder whose name is a hash of all compiled sources and of the
versions of numba, MuJoCo and Python.
"""

from __future__ import annotations

import gc
import hashlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any, cast

import mujoco

from impactlaw.compiling import LATER, Declared, start_helpers
from impactlaw.errors import UncompilableError
from impactlaw.locks import HAS_LOCKS, alone

_NEEDED = (
    "time stepping, batches, contacts with friction that collide together, cylinders, capsules at boxes, edges and "
    "corners of boxes at boxes, and the laws routh and compliant need it"
)

try:
    import numba
    from numba.core import sigutils, typeinfer
    from numba.core.caching import FunctionCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    from impactlaw.parts import LinkedCompiler
except ImportError as error:
    raise UncompilableError(f"numba cannot be imported ({error}); {_NEEDED}: pip install --upgrade numba") from error
if cast(Any, numba).config.DISABLE_JIT:
    raise UncompilableError(f"numba compiles nothing, since NUMBA_DISABLE_JIT is set; {_NEEDED}")

_PARTS = (
    "solvers/cones/algebra",
    "solvers/cones",
    "stepping/compiled",
    "stepping/compiled/left_out",
    "stepping/time_stepping/problem",
    "stepping/time_stepping/problem/solution",
    "stepping/time_stepping",
    "stepping/time_stepping/compiled/state",
    "stepping/time_stepping/compiled/detection",
    "stepping/time_stepping/compiled/impulses",
    "stepping/time_stepping/compiled",
    "stepping/soft/compiled/contacts",
    "stepping/soft/compiled",
)
"""Folders of this package with compiled functions; each folder uses its own functions and those of earlier folders."""

_KEPT = f"{__name__}.Kept"
_UNKEPT = "in every process anew, since {}: NUMBA_CACHE_DIR can name one that has room for some 20 MB;"

_ALSO = (
    "parts.py",
    "laws/tolerances.py",
    "laws/friction/share.py",
    "mechanics/tolerances.py",
    "scene/tolerances.py",
    "scene/equality_constraints.py",
    "scene/corrected/rounding.py",
    "scene/corrected/hidden_edges.py",
    "scene/corrected/edge_on_face.py",
    "scene/corrected/face_on_face.py",
    "scene/corrected/side_by_side.py",
    "scene/corrected/standing.py",
    "stepping/soft/tolerances.py",
    "stepping/soft/pressed_contacts.py",
    "solvers/friction/single_contact.py",
    "linked.py",
)
"""Further files on which compiled functions depend: how they are compiled, and constants that are compiled in."""


@cache
def cache_folder(parts: int = len(_PARTS)) -> Path | None:
    """Return the folder for compiled functions of this version; None if there is none and it cannot be made.

    It is in ``NUMBA_CACHE_DIR`` if that is set, else in ``XDG_CACHE_HOME`` or ``~/.cache``. A folder that can only be
    read, as in the image of a container, serves with what is in it.

    Args:
        parts: number of folders of sources, from the first one, that determine the name.
    """
    digest = hashlib.sha256(f"{numba.__version__} {mujoco.__version__} {sys.version}".encode())
    root = Path(__file__).parent
    for name in _ALSO:
        digest.update((root / name).read_bytes())
    for folder in _PARTS[:parts]:
        for path in sorted((root / folder).glob("*.py")):
            digest.update(path.read_bytes())
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        folder = Path(base or Path.home() / ".cache") / "impactlaw" / digest.hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: this user has no home directory
        return None
    return folder


def _parts(module: str) -> int:
    """Return the number of folders of sources on which the functions of a module may depend."""
    inside = [i for i, part in enumerate(_PARTS) if f"impactlaw.{part.replace('/', '.')}." in f"{module}."]
    return max(inside, default=len(_PARTS) - 1) + 1


def _is_writable(folder: Path | None) -> bool:
    return folder is not None and os.access(folder, os.W_OK)


@cache
def _tell() -> None:
    how = "once;" if _is_writable(cache_folder()) else _UNKEPT.format("there is no folder that can be written")
    print(f"impactlaw: compiling contact, {how} this takes up to two minutes", file=sys.stderr)


@cache
def _tell_unkept(reason: str) -> None:
    print(f"impactlaw: compiling contact {_UNKEPT.format(reason)}", file=sys.stderr)


@cache
def announce(module: str) -> None:
    """Say on stderr, once, that the functions of a module will be compiled, if none of them is in the cache."""
    folder = cache_folder(_parts(module))
    if folder is None or not any(folder.rglob("*.nbi")):
        _tell()


@cache
def compile_together(module: str) -> None:
    """Start helper processes that also compile, if there are locks and functions of a module are not in the cache yet.

    Args:
        module: full name of the module, which is imported next and imports everything that needs to be compiled.
    """
    folder = cache_folder(_parts(module))
    if folder is not None and not any((folder / module).glob("*.nbi")):
        announce(module)
        if HAS_LOCKS and _is_writable(folder):
            start_helpers(module, folder)


def help_with(module: str, lock: str) -> None:
    """Compile the functions a module uses, last ones first, except those that another process is compiling."""
    with alone(Path(lock), wait=False) as mine:
        if not mine:
            return
        later: list[Callable[[], Any]] = []
        _Cache.must_save = True
        LATER.set(later)
        import_module(module)
        LATER.set(None)
        for compile_it in reversed(later):
            compile_it()


class Kept:
    """A numba cache locator that finds functions by module name, so that all installations of a version share a cache.

    With numba's own locators each folder in which the package is installed would have its own cache.
    """

    def __init__(self, function: Callable[..., Any], source: str):
        self._source = Path(source)
        self._path = Path(cast(Any, numba).config.CACHE_DIR) / function.__module__
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> Kept:
        """Return the locator of a function, which does not depend on the path of its file."""
        place = cls(function, path)
        place.ensure_cache_path()
        return place

    def ensure_cache_path(self) -> None:
        """Create the folder, if that is possible."""
        with suppress(OSError):
            self._path.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._path)

    def get_source_stamp(self) -> str:
        """Return a hash of the file, which differs between versions; the folder name covers the files it depends on."""
        return hashlib.sha256(self._source.read_bytes()).hexdigest()

    def get_disambiguator(self) -> str:
        """Return the line number, which distinguishes functions with the same name in a module."""
        return str(self._line)


class _Cache(FunctionCache):
    """The cache of a function, without which a process does, too: a disk may be full, or a folder not writable."""

    must_save = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature, or None if it cannot be read."""
        with suppress(OSError):
            return super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function if possible; a helper, which only compiles for others, ends if it is not."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            if self.must_save:
                raise
            _tell_unkept(str(error))


def compiled(*signature: Any, counts: bool = True, python: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function when it is first called, or at once if its signature is given.

    A helper process of `compiling` postpones the compilation. This is not possible if the signature lacks the return
    type, since callers of the function could not be compiled before it.

    Args:
        signature: signature of the function, as a string or a numba object.
        counts: whether the function uses numba's reference counts of arrays. A function that creates no array does not
            need them, see `loops.plain`.
        python: whether Python calls the function; if not, see `linked`.
    """
    options: dict[str, Any] = {"_nrt": counts}
    if not python:
        options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": LinkedCompiler}

    def decorate(function: Callable[..., Any]) -> Any:
        if not signature:
            return _compile(function, (), options)
        arguments, returned = cast(Any, sigutils).normalize_signature(*signature)
        later = LATER.get()
        if later is None or returned is None:
            announce(function.__module__)
            return _compile_alone(function, signature, options, wait=True)
        later.append(lambda: _compile_alone(function, signature, options, wait=False))
        return Declared(function, arguments, returned)

    return decorate


@cache
def for_python(part: Any) -> Any:
    """Return a function that Python calls, for one that compiled functions call; see `loops.plain`."""
    function = part.py_func
    folder = cache_folder(_parts(function.__module__))
    if folder is None or not any((folder / function.__module__).glob(f"*.{function.__name__}-*.nbi")):
        _tell()
    return compiled()(function)


def _compile_alone(
    function: Callable[..., Any], signature: tuple[Any, ...], options: dict[str, Any], *, wait: bool
) -> Any:
    """Compile a function while holding its lock, so that no other process compiles it, too; see `locks.alone`."""
    folder = cache_folder(_parts(function.__module__))
    name = f"{function.__module__}.{function.__name__}.lock"
    with alone(folder and folder / name, wait=wait) as mine:
        return _compile(function, signature, options) if mine else None


def _fill_tables() -> None:
    """Enter what has been declared since the last compilation into numba's tables.

    A compilation would do so itself, but numba, interrupted meanwhile, lacks what it was about to enter for good.
    Ctrl-C interrupts only the main thread. A thread that compiles already would wait for itself.
    """

    def fill() -> None:
        with cast(Any, global_compiler_lock):
            cast(Any, cpu_target).target_context.refresh()  # fills the tables of types, too

    if not cast(Any, global_compiler_lock).is_locked():
        thread = Thread(target=fill)
        thread.start()
        thread.join()


def _compile(function: Callable[..., Any], signature: tuple[Any, ...], options: dict[str, Any]) -> Any:
    folder, settings = cache_folder(_parts(function.__module__)), cast(Any, numba).config
    kept = settings.CACHE_DIR, getattr(settings, "CACHE_LOCATOR_CLASSES", "")
    settings.CACHE_DIR, settings.CACHE_LOCATOR_CLASSES = "" if folder is None else str(folder), _KEPT
    collects = gc.isenabled()
    gc.disable()  # numba creates millions of objects, and repeated garbage collection would take a tenth longer
    try:
        _fill_tables()
        made = cast(Any, numba.njit)(error_model="numpy", nogil=True, **options)(function)
        if folder is not None:
            made._cache = _Cache(function)
        if signature:
            with cast(Any, typeinfer).register_dispatcher(made):  # as njit does: the function may call itself
                made.compile(*signature)
                made.disable_compile()
        return made
    finally:
        settings.CACHE_DIR, settings.CACHE_LOCATOR_CLASSES = kept
        if collects:
            gc.enable()
