"""Policies that tests of studies name as "studies.acting:...", and their counters."""

import os
import time
from pathlib import Path

import numpy as np


def stay(observation):
    """Aim straight, at a low speed."""
    return 0.0, -1.0


def fall_over(observation):
    """Raise an error."""
    raise RuntimeError("fell over")


class Slow:
    """A policy that takes its time, and records the start of each episode in a file."""

    def __init__(self):
        with Path(os.environ["STUDIES_BEGUN"]).open("a") as file:
            file.write("begun\n")
        time.sleep(0.4)

    def __call__(self, observation):
        """Aim in a direction that depends on the start."""
        return float(np.clip(observation[1], -1, 1)), 1.0
