"""Random scenes of 2 to 30 bodies, and piles in a bin: are there exceptions or long steps, is energy created?

No actuator or force feeds energy into these scenes. The largest gain of energy over any interval, relative to the range
of the energy, is therefore an error. It is judged under RK4 only, because the other integrators gain energy by
themselves where bodies spin fast. The energy that RK4 gains in a step from the same state without contact is
subtracted.
"""

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
import pandas as pd
from tqdm import tqdm

from impactlaw import Stepper
from impactlaw.errors import ManyCollisionsWarning
from impactlaw.scene.contacts import update_positions
from impactlaw.stepping.time_stepping.make import compile_steps
from scripts.options import Count, Seconds, Seed, read

from . import making

LONGEST = 0.2
"""Longest allowed processor time of a step, s."""
GAIN = 0.02
"""Largest allowed gain of energy, as a part of the range of the energy."""
TELL = 10
"""Number of scenes after which a line is printed."""
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)


@dataclass(frozen=True, kw_only=True)
class RandomScenes:
    """Which scenes to run, and how."""

    scenes: Count = 60
    """Number of random scenes; 300, with 40 piles, take about 25 minutes."""
    piles: Count = 8
    """Number of piles in a bin."""
    seconds: Seconds = 1.0
    """Simulated time of each scene and pile."""
    first: Seed = 0
    """Seed of the first scene and of the first pile."""
    scheme: Literal["event-driven", "time-stepping"] = "event-driven"
    """Scheme of the stepper."""


def energy(model: mujoco.MjModel, scratch: mujoco.MjData, data: mujoco.MjData) -> float:
    """Return the energy of the state in `data`, J."""
    scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
    update_positions(model, scratch)
    mujoco.mj_energyPos(model, scratch)
    mujoco.mj_energyVel(model, scratch)
    return float(scratch.energy.sum())


def flown(model: mujoco.MjModel, scratch: mujoco.MjData, data: mujoco.MjData) -> float:
    """Return the energy that MuJoCo's integrator gains in a step from this state without contact, J."""
    flags = model.opt.disableflags
    model.opt.disableflags |= _NO_CONTACT
    scratch.qpos[:], scratch.qvel[:], scratch.qacc_warmstart[:] = data.qpos, data.qvel, 0.0
    before = energy(model, scratch, data)
    mujoco.mj_step(model, scratch)
    gained = energy(model, scratch, scratch) - before
    model.opt.disableflags = flags
    return max(gained, 0.0)


def run(made: making.Made, options: RandomScenes) -> dict[str, object]:
    """Step a scene to its end, and return its row of the table."""
    model, data, law = made
    stepper, scratch = Stepper(model, law, scheme=options.scheme, overlap="push-out"), mujoco.MjData(model)
    row: dict[str, object] = {"bodies": model.nbody - 1, "nv": model.nv, "law": repr(law), "outcome": "fine"}
    count, longest, energies = round(options.seconds / model.opt.timestep), 0.0, [energy(model, scratch, data)]
    allowed: list[float] = []
    try:
        for _ in range(count):
            allowed.append(flown(model, scratch, data))
            begun = time.process_time()
            stepper.step(data)
            longest = max(longest, time.process_time() - begun)
            energies.append(energy(model, scratch, data))
    except Exception as error:
        row["outcome"] = f"{type(error).__name__}: {error}"[:90]
    span = max(energies) - min(energies) + 1e-9
    gains = np.diff(energies) - allowed[: len(energies) - 1]
    total = np.cumsum([0.0, *gains])
    gain = float((total - np.minimum.accumulate(total)).max() / span)
    exact = model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)
    row |= {"gain": gain if exact else np.nan, "gain_of_all": gain}
    return row | {"steps": len(gains), "longest": longest, "unlocated": stepper.unlocated}


def rows(options: RandomScenes) -> Iterator[dict[str, Any]]:
    """Yield one row per scene."""
    makers: tuple[tuple[str, Callable[[int], making.Made], int], ...] = (
        ("scene", making.scene, options.scenes),
        ("pile", making.pile, options.piles),
    )
    for kind, make, count in makers:
        for seed in range(options.first, options.first + count):
            yield {"kind": kind, "seed": seed} | run(make(seed), options)


def wrong(row: dict[str, Any]) -> bool:
    """Return whether a scene ended with an exception, had a long step, or gained energy."""
    return row["outcome"] != "fine" or row["longest"] > LONGEST or row["gain"] > GAIN


def told(options: RandomScenes) -> Iterator[dict[str, Any]]:
    """Yield the rows, and print a failure as soon as it is found, else a line for every tenth scene."""
    failures, longest = 0, 0.0
    with tqdm(rows(options), total=options.scenes + options.piles, unit="scene", disable=None) as bar:
        for i, row in enumerate(bar, 1):
            failures, longest = failures + wrong(row), max(longest, row["longest"])
            if wrong(row):
                bar.write(", ".join(f"{name} {value}" for name, value in row.items()))
            elif i % TELL == 0:
                bar.write(f"{i} of {bar.total}: {failures} failures so far, longest step {longest:.3f} s")
            sys.stdout.flush()
            yield row


def main() -> int:
    """Run all scenes, and print failures and the largest step time and gain; return 1 if there are failures.

    What is found until an interrupt is printed, too.
    """
    options = read(RandomScenes, __doc__)
    warnings.simplefilter("ignore", ManyCollisionsWarning)
    compile_steps()
    table: list[dict[str, Any]] = []
    with suppress(KeyboardInterrupt):
        table.extend(told(options))
    if not table:
        return 1
    found = pd.DataFrame(table)
    with pd.option_context("display.width", 200, "display.max_rows", None, "display.max_colwidth", 90):
        print(found.groupby("kind")[["steps", "unlocated"]].sum())
        print(found.groupby("kind")[["longest", "gain", "gain_of_all"]].max())
    failures, ended = sum(map(wrong, table)), len(table) == options.scenes + options.piles
    print(f"{failures} of {len(found)} ended with an exception, took {LONGEST} s in a step, or gained energy")
    return int(failures > 0 or not ended)


if __name__ == "__main__":
    sys.exit(main())
