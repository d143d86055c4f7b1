"""Processes in which the cells of a study run."""

import signal
from functools import partial

from impactlaw.studies.backends import workers


def test_ctrl_c_of_a_terminal_ends_workers_without_a_traceback():
    with workers("loky", None, 2) as call:
        assert list(call([partial(signal.getsignal, signal.SIGINT)] * 2)) == [signal.SIG_DFL] * 2
