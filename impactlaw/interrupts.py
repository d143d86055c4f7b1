"""Ctrl-C while the command `impactlaw` imports its packages: it ends at once, as there is nothing to tidy up.

A `KeyboardInterrupt` would end in a traceback there, or, in compiled packages, as an ImportError. `impactlaw.signals`
takes over when the command begins. Other programs that import this package keep their handlers.
"""

import signal
import sys
from pathlib import PurePath

if [PurePath(word).stem for word in sys.orig_argv[1:2]] == ["impactlaw"] and (
    signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else it is ignored, or somebody's own
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
