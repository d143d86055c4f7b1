"""Newton's cradle under two laws and under MuJoCo's contacts, side by side: ``python -m scripts.pictures.cradles``."""

import sys
from functools import partial
from pathlib import Path

import matplotlib as mpl
import mujoco
import numpy as np
import tyro

from impactlaw import Fremond, Law, Moreau, Stepper
from impactlaw.models import load
from scripts.options import make_folder

_RAIL, _RADIUS, _SPACING = 1.25, 0.125, 0.25  # m, as in the scene
_LIFTED = 0.7  # rad, angle of the first ball at the start
_COLORS = ("#c0392b", "#aeb6bf", "#aeb6bf", "#aeb6bf", "#aeb6bf")


_SECONDS, _FRAMES = 4.0, 15  # duration of the motion, about two periods; frames per second, in real time


def swings(law: Law | None, times: np.ndarray) -> np.ndarray:
    """Return the angles of the five balls at these times, rad, (n, 5); without a law, contacts are MuJoCo's."""
    model, data = load("newtons_cradle")
    data.qpos[0], data.qvel[0] = -_LIFTED, 0.0
    step = partial(mujoco.mj_step, model) if law is None else Stepper(model, law).step
    angles = []
    for time in times:
        while data.time < time - 1e-9:
            step(data)
        angles.append(data.qpos.copy())
    return np.array(angles)


def main(out: Path = Path("out/cradles.gif")) -> None:
    """Animate the cradle under the reversal law, under Moreau's law and under MuJoCo's own contacts.

    Args:
        out: file of the animation.
    """
    make_folder(out.parent)
    if out.is_dir():
        sys.exit(f"{out} is a folder, not a file")
    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.patches import Circle

    times = np.arange(0.0, _SECONDS, 1.0 / _FRAMES)
    runs = {
        "reversal law": swings(Fremond.reversal(), times),
        "Moreau's law, e = 1": swings(Moreau(1.0), times),
        "MuJoCo's contacts": swings(None, times),
    }
    figure, panels = plt.subplots(1, 3, figsize=(7.8, 2.3), dpi=100)
    rest = _SPACING * (np.arange(5) - 2)
    drawn = []
    for panel, (name, _) in zip(panels, runs.items(), strict=True):
        panel.set(xlim=(-1.3, 1.3), ylim=(0.07, 1.32), aspect="equal", title=name)
        panel.axis("off")
        panel.plot([-0.75, 0.75], [_RAIL, _RAIL], color="#34495e", linewidth=4, solid_capstyle="round")
        strings = [panel.plot([], [], color="#7f8c8d", linewidth=1)[0] for _ in rest]
        balls = [Circle((0, 0), _RADIUS, facecolor=c, edgecolor="#34495e") for c in _COLORS]
        for ball in balls:
            panel.add_patch(ball)
        drawn.append((strings, balls))
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.88, wspace=0.0)

    def draw(frame: int) -> None:
        for (strings, balls), angles in zip(drawn, runs.values(), strict=True):
            x, z = rest + np.sin(angles[frame]), _RAIL - np.cos(angles[frame])
            for i, (string, ball) in enumerate(zip(strings, balls, strict=True)):
                string.set_data([rest[i], x[i]], [_RAIL, z[i]])
                ball.center = x[i], z[i]

    animation = FuncAnimation(figure, draw, frames=len(times), init_func=lambda: None)
    animation.save(out, writer=PillowWriter(fps=_FRAMES))
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB, {len(times)} frames")


if __name__ == "__main__":
    tyro.cli(main)
