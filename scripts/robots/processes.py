"""Run each case in a process of its own, so that a crash or a hang costs one row only."""

import os

import mujoco

from scripts.apart import LostError, Worker

from .case import Case, Row, described, run

LOADING = 200.0
"""Wall time that a case may take in addition to its own, s: for loading the scene, and for the last step."""


def apart(case: Case) -> Row:
    """Run a case in a new process and return its row, which has few columns if the case crashes or hangs."""
    with Worker(_silence) as worker:
        try:
            return worker.call(_measured, case, budget=case.seconds + LOADING)
        except LostError as error:
            return case.row() | {"outcome": ": ".join(error.args)}


def _silence() -> None:
    """Silence the output of this process; only the parent prints."""
    mujoco.set_mju_user_warning(lambda message: None)  # counted in data.warning; no file of warnings
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


def _measured(case: Case) -> Row:
    try:
        return run(case)
    except Exception as error:  # outside of a step: in the study, or in MuJoCo after a step
        return case.row() | {"outcome": f"not measurable: {described(error)}"}
