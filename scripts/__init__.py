"""Examples and measurements.

Scripts, and the processes that they start, use one BLAS thread: on a busy machine two take up to a hundred times as
long. Ctrl-C ends a script without a traceback, also while it is imported.
"""

import os
import sys
from types import TracebackType

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # numpy reads them when it is imported
    os.environ.setdefault(_name, "1")

_tell = sys.excepthook


def _interrupted(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Tell of Ctrl-C in one word, and of other errors as before; Python then exits with the code that they have."""
    if issubclass(kind, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
    else:
        _tell(kind, error, trace)


sys.excepthook = _interrupted
