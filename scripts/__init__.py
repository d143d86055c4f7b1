"""Examples and measurements.

Scripts, and the processes that they start, use one BLAS thread: on a busy machine two take up to a hundred times as
long.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # numpy reads them when it is imported
    os.environ.setdefault(_name, "1")
