"""Processes that run the cells of a study."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from impactlaw.studies.backends import workers

SLOW = """
import sys, time
if any("popen_loky" in word for word in sys.orig_argv):
    open({started!r}, "w").close()
    time.sleep(1.5)
"""


@pytest.fixture
def heeded():
    """Handle Ctrl-C, which background processes ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded")
def test_ctrl_c_of_a_terminal_ends_workers_without_a_traceback():
    with workers("loky", None, 2) as call:
        assert list(call([partial(signal.getsignal, signal.SIGINT)] * 2)) == [signal.SIG_DFL] * 2
        blocked = call([partial(signal.pthread_sigmask, signal.SIG_BLOCK, ())] * 2)
        assert not any(signal.SIGINT in signals for signals in blocked)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.skipif(sys.platform == "win32", reason="no groups of processes")
@pytest.mark.parametrize(
    ("handler", "message", "code"), [("default_int_handler", "impactlaw: interrupted\n", 130), ("SIG_IGN", "", 0)]
)
def test_it_ends_workers_that_are_still_starting(handler, message, code, tmp_path: Path):
    """They wait for 1.5 s before their first import. In the background they continue."""
    started = tmp_path / "started"
    (tmp_path / "sitecustomize.py").write_text(SLOW.format(started=str(started)))
    script = f"""if True:
        import signal
        from impactlaw.signals import ended_by_signals
        from impactlaw.studies.backends import workers
        signal.signal(signal.SIGINT, signal.{handler})
        with ended_by_signals(), workers("loky", None, 2) as call:
            list(call([int] * 2))"""
    command = subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not started.exists():
        assert command.poll() is None
        time.sleep(0.05)
    os.killpg(command.pid, signal.SIGINT)
    _, told = command.communicate(timeout=60)  # ends when the workers have ended, too, because they hold this pipe
    assert told == message
    assert command.returncode == code
