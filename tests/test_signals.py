"""Ctrl-C and SIGTERM end a command even where Python loses the exception."""

import signal
import subprocess
import sys
import time

import pytest

from impactlaw.signals import ended_by_signals

ENDS = [(signal.SIGINT, 130), (signal.SIGTERM, 143)]


@pytest.fixture(autouse=True)
def handlers():
    """Restore the signal handlers after the test."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Finalized:
    """Raises a signal while it is finalized."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        """Raise the signal."""
        signal.raise_signal(self.number)


@pytest.mark.parametrize(("number", "code"), ENDS)
def test_an_exit_that_a_finalizer_loses_is_raised_again(number, code, capsys):
    went_on = []
    with pytest.raises(SystemExit) as ended, ended_by_signals():
        Finalized(number)
        time.sleep(30.0)
        went_on.append(True)
    assert ended.value.code == code
    assert not went_on
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_an_exit_that_is_lost_without_a_word_is_raised_again():
    went_on = []
    with pytest.raises(SystemExit) as ended, ended_by_signals():
        with pytest.raises(SystemExit):
            signal.raise_signal(signal.SIGTERM)
        time.sleep(60.0)
        went_on.append(True)
    assert ended.value.code == 143
    assert not went_on


def test_an_exit_that_is_lost_until_the_end_is_an_exit():
    with pytest.raises(SystemExit) as ended, ended_by_signals():
        Finalized(signal.SIGTERM)
    assert ended.value.code == 143


def test_errors_that_come_of_the_end_are_not_told():
    with pytest.raises(SystemExit) as ended, ended_by_signals():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            raise ValueError("half written")
    assert ended.value.code == 143


@pytest.mark.parametrize(("name", "ends"), [("impactlaw", ""), ("other.py", "KeyboardInterrupt")])
def test_ctrl_c_while_the_command_is_imported_leaves_no_traceback(name, ends, tmp_path):
    (tmp_path / name).write_text("import impactlaw, signal, time\nsignal.raise_signal(signal.SIGINT)\ntime.sleep(9)\n")
    command = [sys.executable, str(tmp_path / name)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=heed_interrupts)
    assert ended.returncode == -signal.SIGINT  # 130 in a shell
    assert ended.stderr.splitlines()[-1:] == ([ends] if ends else [])


def heed_interrupts():
    """Handle SIGINT, which is ignored if a shell has started the tests in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_other_errors_are_raised():
    with pytest.raises(ValueError, match="wrong"), ended_by_signals():
        raise ValueError("wrong")
