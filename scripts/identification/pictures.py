"""The picture of chains: outcomes of three balls in S, over exponent and ratio of stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scripts.identification.chains import EXPONENTS, RATIOS, paths


def draw_paths(path: Path) -> None:
    """Draw ``gamma+`` of three equal balls, the first launched, where S is a sector of 60 degrees."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    # G^-1 = (2 1; 1 2) / 3: gamma+ = (a, b) lies at a e_1 + b e_2 with |e| = sqrt(2/3) and 60 degrees between
    base = np.sqrt(2.0 / 3.0) * np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    angle = np.linspace(0.0, np.pi / 3.0, 100)
    arc = np.sqrt(2.0 / 3.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    axes.fill(*np.vstack([[0.0, 0.0], arc]).T, color="C2", alpha=0.2, label="S(v-)")
    for marker, (name, gamma) in zip("os", paths().items(), strict=True):
        axes.plot(*(gamma @ base).T, marker=marker, markersize=5, linewidth=1, label=f"over the {name}")
    values = dict(zip(("exponent", "stiffness ratio"), (EXPONENTS, RATIOS), strict=True))
    for name, gamma in paths().items():
        for value, point in list(zip(values[name], gamma @ base, strict=True))[:: 2 if name == "exponent" else 3]:
            axes.annotate(f"{value:g}", point, fontsize=7, xytext=(4, 2), textcoords="offset points")
    for name, corner in {"E = 0": (0.0, 0.0), "Moreau, e = 1": (1.0, 0.0), "reversal": (0.0, 1.0)}.items():
        place = np.array(corner) @ base
        axes.plot(*place, "k*", markersize=9)
        axes.annotate(name, place, fontsize=8, xytext=(5, -10), textcoords="offset points")
    axes.set_aspect("equal")
    axes.set_xlabel("gamma+ in the kinetic metric, sqrt(J)")
    axes.legend(fontsize=8, loc="upper right")
    figure.savefig(path, dpi=80, pil_kwargs={"optimize": True})
