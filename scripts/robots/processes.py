"""Each case in a process of its own: a crash or a hang costs one row."""

import os

import mujoco

from scripts.apart import CrashesError, HangsError, Worker

from .case import Case, Row, described, run

LOADING = 200.0
"""Wall time that a case may take beyond its own, s: for loading a scene, and for the step that is under way."""
_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def prepare() -> None:
    """Let all processes started from now on use one BLAS thread each, and no graphics."""
    os.environ.update(_ENVIRONMENT)
    os.environ.setdefault("MUJOCO_GL", "disable")


def apart(case: Case) -> Row:
    """Run a case in a new process and return its row, of which little is known where it crashes or hangs."""
    with Worker(_silence) as worker:
        try:
            return worker.call(_measured, case, budget=case.seconds + LOADING)
        except (HangsError, CrashesError) as error:
            return case.row() | {"outcome": f"{'hangs' if isinstance(error, HangsError) else 'crashes'}: {error}"}


def _silence() -> None:
    """Print nothing: the table is the parent's."""
    mujoco.set_mju_user_warning(lambda message: None)  # counted in data.warning; MuJoCo would write a file
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


def _measured(case: Case) -> Row:
    try:
        return run(case)
    except Exception as error:  # not of a step: the study's own, or MuJoCo's about the state that a step has left
        return case.row() | {"outcome": f"not measurable: {described(error)}"}
