"""The options of scripts, which are checked before anything runs: types of numbers, and `read`."""

import math
import sys
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from tyro.constructors import PrimitiveConstructorSpec

_Options = TypeVar("_Options")


def _number(kind: type[Any], allowed: Callable[[Any], bool], what: str) -> PrimitiveConstructorSpec[Any]:
    """Return how the command line reads a number, and refuses one that is not allowed."""

    def read_one(words: list[str]) -> Any:
        try:
            number = kind(words[0])
        except ValueError:
            number = None
        if number is None or not allowed(number):
            raise ValueError(f"it must be {what}, got {words[0]!r}")
        return number

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=kind.__name__.upper(),
        instance_from_str=read_one,
        is_instance=lambda value: isinstance(value, kind | int),
        str_from_instance=lambda value: [str(value)],
    )


Count = Annotated[int, _number(int, lambda n: n >= 1, "a whole number of 1 or more")]
Seed = Annotated[int, _number(int, lambda n: n >= 0, "a whole number of 0 or more")]
Jobs = Annotated[int, _number(int, lambda n: n >= 1 or n == -1, "1 or more, or -1 for one per processor")]
Seconds = Annotated[float, _number(float, lambda t: 0.0 < t < math.inf, "a positive number of seconds")]
Coefficient = Annotated[float, _number(float, lambda e: 0.0 <= e <= 1.0, "a number from 0 to 1")]


def read(kind: type[_Options], description: str | None) -> _Options:
    """Return the options of the command line, and make the folder "out" if there is such an option.

    Numbers that their types do not allow, options of several values that have none, and a folder that cannot be written
    into end the program with exit code 2 and a message that names them.
    """
    options: Any = tyro.cli(kind, description=description)
    for field in fields(options):
        value = getattr(options, field.name)
        if value == () != field.default:
            _refuse(f"--{field.name} is empty: there is nothing to run")
        if field.name == "out":
            make_folder(value)
    return options


def make_folder(folder: Path) -> None:
    """Make a folder; one that cannot be made or written into ends the program, as in `read`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        _refuse(f"cannot write into {folder}: {error.strerror}")


def _refuse(why: str) -> None:
    print(why, file=sys.stderr)
    sys.exit(2)
