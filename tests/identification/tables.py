"""Tables of collisions, and the command line that reads them."""

import json
import sys

import numpy as np
import pandas as pd
from problems import balls

from impactlaw import Collision, Newton
from impactlaw.cli import main


def run_cli(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["impactlaw", *map(str, words)])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    said = capsys.readouterr()
    return code, said.out, said.err


def row(c: Collision, after, **more):
    """Return a row of a table of contact velocities."""
    lists = {
        "contacts": list(c.labels),
        "pre_contact_velocity": c.pre_contact_velocity.tolist(),
        "post_contact_velocity": (c.jacobian @ after).tolist(),
        "delassus": c.delassus.tolist(),
    }
    return {name: json.dumps(value) for name, value in (lists | more).items()}


def chain_rows(n=12, law=None, seed=0):
    law, rng, rows = law or Newton([0.3, 0.8]), np.random.default_rng(seed), []
    for _ in range(n):
        c = balls([1.0, 2.0, 1.5], np.sort(rng.normal(size=3))[::-1])
        c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, labels=("a/b", "b/c"))
        impact = law.resolve(c)
        rows.append(row(c, impact.post_velocity, impulse=impact.impulse.tolist()))
    return rows


def table(path, rows):
    frame = pd.DataFrame(rows)
    if path.suffix == ".parquet":
        frame = frame.map(json.loads)
        frame["delassus"] = [np.ravel(cell).tolist() for cell in frame["delassus"]]
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False)
    return path
