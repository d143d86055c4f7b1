"""Times of fresh processes: what ``import impactlaw`` adds to ``import mujoco``, and compiling or loading steps."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from .timing import Row

_IMPORT = """
import json, sys, time
start = time.perf_counter()
import mujoco
middle, before = time.perf_counter(), len(sys.modules)
import impactlaw
end, modules = time.perf_counter(), len(sys.modules) - before
print(json.dumps({"mujoco_s": middle - start, "added_s": end - middle, "modules": modules}))
"""
_COMPILE = """
import json, time
start = time.process_time()
import mujoco
from impactlaw import Moreau, Stepper
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .1"><freejoint/><geom size=".1"/></body>'
    '</worldbody></mujoco>')
for options in ({"scheme": "time-stepping"}, {"contact_model": "soft"}):
    Stepper(model, Moreau(0.5), **options).step(mujoco.MjData(model))
print(json.dumps({"processor_s": time.process_time() - start}))
"""


def run_imports(processes: int = 15) -> Iterator[Row]:
    """Yield one row per process: mujoco_s, added_s, and the number of modules that impactlaw loads."""
    for _ in range(processes):
        yield _said(_IMPORT, {})


def run_compiling(loads: int = 3) -> Iterator[Row]:
    """Yield the processor time, s, from the start of a process to its first steps, which compiles, or loads.

    The first process compiles into an empty cache, others load from it. Python's bytecode is cached as well, as usual.
    """
    with tempfile.TemporaryDirectory() as cache:
        for number in range(1 + loads):
            said = _said(_COMPILE, {"NUMBA_CACHE_DIR": cache, "PYTHONPYCACHEPREFIX": cache})
            yield {"process": "compiles" if number == 0 else "loads"} | said


def _said(code: str, variables: dict[str, str]) -> Row:
    """Run code in a fresh process with these environment variables, and return what it prints."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return json.loads(subprocess.check_output([sys.executable, "-c", code], text=True, env=inherited | variables))
