"""The study "cone solvers": contact problems with friction from time stepping, solved by our solver and by others."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy: time one thread
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MUJOCO_GL", "disable")
