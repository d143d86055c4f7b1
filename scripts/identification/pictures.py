"""The picture of chains: outcomes of three balls in S, over exponent and stiffness ratio."""

from pathlib import Path

import numpy as np

from impactlaw import Compliant
from scripts.identification.chains import EXPONENTS, outcomes, paths


def draw_paths(path: Path) -> None:
    """Draw ``gamma+`` of three equal balls, the first one launched; S is a sector of 60 degrees."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 4.6), layout="constrained")
    axes = figure.subplots()
    # gamma+ = (a, b) lies at a e_1 + b e_2 with |e| = sqrt(2/3) and 60 degrees between
    base = np.sqrt(2.0 / 3.0) * np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    angle = np.linspace(0.0, np.pi / 3.0, 100)
    arc = np.sqrt(2.0 / 3.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    axes.fill(*np.vstack([[0.0, 0.0], arc]).T, color="C2", alpha=0.2, label="S(v-)")
    ratios = outcomes([Compliant([1.0, r]) for r in np.geomspace(1e-3, 1e3, 121)]) @ base
    axes.plot(*ratios.T, color="C1", linewidth=1.5, label="stiffness ratio k2/k1")
    for ratio in (0.1, 1.0, 2.0, 3.0, 5.0, 10.0):
        point = (outcomes([Compliant([1.0, ratio])]) @ base)[0]
        axes.plot(*point, "s", color="C1", markersize=5)
        axes.annotate(f"{ratio:g}", point, fontsize=8, xytext=(6, 1), textcoords="offset points")
    points = paths()["exponent"] @ base
    axes.plot(*points.T, "o", color="C0", markersize=4, label="exponent p, equal stiffness")
    for p, point in zip(EXPONENTS, points, strict=True):
        axes.annotate(f"p = {p:g}", point, fontsize=7, color="C0", xytext=(-34, -9), textcoords="offset points")
    for name, corner, shift in (
        ("E = 0", (0.0, 0.0), (8, 6)),
        ("Moreau, e = 1", (1.0, 0.0), (-75, 6)),
        ("reversal", (0.0, 1.0), (-48, 4)),
    ):
        place = np.array(corner) @ base
        axes.plot(*place, "k*", markersize=9)
        axes.annotate(name, place, fontsize=9, xytext=shift, textcoords="offset points")
    axes.set_aspect("equal")
    axes.set_xlabel("gamma+ in the kinetic metric, sqrt(J)")
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.52, 0.12))
    figure.savefig(path, dpi=80)
