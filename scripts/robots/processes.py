"""Each case in a process of its own: a crash or a hang costs one row."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from multiprocessing.connection import Connection
from typing import Any

import mujoco

from .case import Case, Row, described, run
from .ways import Way, warm_up

LOADING = 180.0
"""Wall time that loading a scene may take, s: solvers may have to be compiled anew."""
HANGING = 30.0
"""Wall time of one step after which it is cut where a case has more than that, s."""
_GRACE = 2.0
_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def prepare() -> None:
    """Let all processes started from now on use one BLAS thread each, and no graphics."""
    os.environ.update(_ENVIRONMENT)
    os.environ.setdefault("MUJOCO_GL", "disable")


def compile_first(way: Way) -> None:
    """Warm up in a process of its own: what is compiled once and kept on disk takes longer than any case may."""
    process = multiprocessing.get_context("spawn").Process(target=warm_up, args=(way, 0.5))
    process.start()
    process.join()


def apart(case: Case) -> Row:
    """Run a case in a new process and return its row, cut where it crashes or hangs."""
    context = multiprocessing.get_context("spawn")
    step = context.RawValue("l", -1)
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(case, sending, step), daemon=True)
    process.start()
    sending.close()
    row, done, waited = case.row(), False, LOADING
    while not done:
        if not receiving.poll(waited):
            process.kill()
            row["outcome"] = f"hangs: a step of more than {waited:.0f} s" if step.value >= 0 else "hangs in loading"
            break
        try:
            row, done = receiving.recv()
        except EOFError:
            process.join()
            row["outcome"] = f"crashes: exit code {process.exitcode}"
            break
        waited = min(case.seconds, HANGING) + _GRACE if step.value >= 0 else LOADING
    process.join()
    receiving.close()
    return row | {"stopped_at": step.value}


def _work(case: Case, sending: Connection, step: Any) -> None:
    """Run the case and send rows: so far, and at the end."""
    mujoco.set_mju_user_warning(lambda message: None)  # counted in data.warning; MuJoCo would write a file
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # the table is the parent's
        os.dup2(nowhere, stream)

    def begin(number: int) -> None:
        step.value = number

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # where libraries may leave their logs
        try:
            row = run(case, lambda row: sending.send((row, False)), begin)
        except Exception as error:  # not of a step: the study's own, or MuJoCo's about the state that a step has left
            row = case.row() | {"outcome": f"not measurable: {described(error)}"}
        os.chdir("/")
    sending.send((row, True))
