"""Translation of the advice in errors and warnings into options of a command, for the command line."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_QUOTES = "\"'"
_NOTE = " ({}: {} of impactlaw.Stepper, in Python)"


def in_options(text: str, command: object) -> str:
    """Return a message in which options of `Stepper`, such as ``scheme="soft"``, are replaced by those of a command.

    Options that the command does not have stay unchanged, with a note that they are options of `Stepper` in Python.

    Args:
        text: the message of an error or a warning.
        command: the command; its fields are its options.
    """
    from impactlaw.stepping.options import Options

    only = dict[str, None]()

    def flag(match: re.Match[str]) -> str:
        name, value = match.groups()
        if value is None and "_" not in name:  # an ordinary word, not an option
            return match[0]
        option = next((option for option in (name, f"{name}s") if hasattr(command, option)), None)
        if option is None:
            only[name] = None
            return match[0]
        return f"--{option.replace('_', '-')}" + (f" {value.strip(_QUOTES)}" if value else "")

    text = re.sub(rf"""\b({"|".join(Options._fields)})\b(?:=("[^"]*"|'[^']*'|[\w.+-]+))?""", flag, text)
    return text + (_NOTE.format(", ".join(only), "options" if len(only) > 1 else "an option") if only else "")


@contextmanager
def warnings_of(command: object) -> Iterator[None]:
    """Print warnings of this package as one line each on standard error, translated by `in_options`."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def tell(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if category.__module__ != "impactlaw.errors":
                show(message, category, *where, **more)
                return
            print(f"impactlaw: {in_options(str(message), command)}", file=sys.stderr)

        warnings.showwarning = tell
        yield
