"""Comparison of a scene under several impact laws and MuJoCo's soft contacts: simulate, audit, tabulate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from itertools import compress
from pathlib import Path

import mujoco
import pandas as pd
from tqdm import tqdm

from impactlaw.comparison import Comparison
from impactlaw.comparison.pictures import draw, freedom_names
from impactlaw.comparison.runs import Run, run_law, run_soft
from impactlaw.comparison.soft_contact import tuned_contacts
from impactlaw.errors import OptionError, RestitutionError, SceneError, check_installed
from impactlaw.laws import LAWS, Fremond, Law, make_law, takes_restitution
from impactlaw.laws.base import coefficient
from impactlaw.laws.restitution.from_scene import scene_law, scene_number, scene_restitution
from impactlaw.models import load
from impactlaw.recording import Recorder

DEFAULT_LAWS = ("maximal-dissipation", "moreau", "scene", "reversal")
_BETWEEN = "; "  # separator of labels, which may contain blanks
_WIDTH = 5  # velocities shown in the printed table
_SOFT = "mujoco, mujoco-tuned: contact takes time, and what gravity does meanwhile is part of v+ and of its violations"
_MOST_STEPS = 1e12  # more would take months


def compare(study: Comparison, folder: Path) -> pd.DataFrame:
    """Simulate all runs, and write table.csv, picture.png and one recording per run into the folder.

    There is one run for each law, one with MuJoCo's contacts as the scene has them ("mujoco"), and one with MuJoCo's
    contacts tuned to the same restitution ("mujoco-tuned", see `impactlaw.comparison.soft_contact`).

    Raises:
        SceneError: the file is not a scene, or not one for rigid stepping; or the timestep or the duration is not a
            positive number, or the duration is shorter than a timestep or more than 1e12 of them.
        OptionError: two runs would have the same name.
        UnknownNameError: there is no such scene or law.
        RestitutionError: a coefficient is not in [0, 1], or a restitution is given but no law takes it.
        MissingExtraError: matplotlib is not installed.
    """
    check_installed("matplotlib", "the picture of a comparison")
    model, start = load(study.scene)
    name = Path(study.scene).stem
    if study.timestep is not None:
        model.opt.timestep = _positive("timestep", study.timestep)
    duration = study.duration if study.duration is not None else scene_number(model, "duration") or 2.0
    steps = _steps(duration, model.opt.timestep)
    restitution = study.restitution if study.restitution is not None else scene_restitution(model)
    restitution = coefficient(1.0 if restitution is None else restitution)
    laws = choose_laws(model, study.laws, restitution)
    if study.restitution is not None:
        _check_taken(study.restitution, laws)
    runs: list[Run] = []
    with ExitStack() as stack:
        bar = stack.enter_context(tqdm(total=steps * (len(laws) + 2), unit="step", disable=None))

        def record(run: str, law: Law | None, of: mujoco.MjModel) -> Recorder:
            path = folder / f"{run}.rrd"
            return stack.enter_context(Recorder(of, path, law=law, scene=name, view=study.view))

        for run, law in laws.items():
            bar.set_description(run)
            recorder = record(run, law, model)
            options = {"scheme": study.scheme, "friction": study.friction}
            runs.append(run_law(model, start, run, law, steps, options=options, recorder=recorder, progress=bar.update))
        reference = next((run for run in runs if run.first is not None), None)
        for run, soft in (("mujoco", model), ("mujoco-tuned", tuned_contacts(model, restitution))):
            bar.set_description(run)
            recorder = record(run, None, soft)
            runs.append(run_soft(soft, start, run, steps, reference, recorder=recorder, progress=bar.update))
    table = tabulate(runs)
    table.to_csv(folder / "table.csv", index=False)
    title = f"{name}, restitution {restitution:g}, timestep {model.opt.timestep:g} s"
    draw(runs, folder / "picture.png", title, freedom_names(model))
    return table


def choose_laws(model: mujoco.MjModel, names: Sequence[str] | None, restitution: float) -> dict[str, Law]:
    """Return the laws by name, each with the restitution if it takes one; "scene" is the law that the scene carries.

    A law from a file, such as law.json, has the name of the file without .json. The default is `DEFAULT_LAWS`, with
    "scene" only if its restitution differs between pairs of geoms.
    """
    if names is None:
        own = any(model.numeric(i).name.startswith("restitution/") for i in range(model.nnumeric))
        names = [name for name in DEFAULT_LAWS if name != "scene" or own]
    if not names:
        known = ", ".join([*(name for name in LAWS if name != Fremond.name), "scene"])
        raise RestitutionError(f"laws is empty: there is nothing to compare; choose from {known}")

    def law(name: str) -> Law:
        if name == "scene":
            return scene_law(model)
        takes = not name.endswith(".json") and takes_restitution(name)
        return make_law(name, restitution if takes else None)

    laws = [law(name) for name in names]
    runs = ["mujoco", "mujoco-tuned", *(Path(name).name.removesuffix(".json") for name in names)]
    twice = [run for i, run in enumerate(runs) if run in runs[:i]]
    if twice:
        raise OptionError(f"laws has {twice[0]!r} twice: runs are named by their laws")
    return dict(zip(runs[2:], laws, strict=True))


def _check_taken(restitution: float, names: Iterable[str]) -> None:
    """Raise `RestitutionError` if none of the laws takes a restitution."""
    if not any(name in LAWS and takes_restitution(name) for name in names):
        laws = ", ".join(map(repr, names))
        raise RestitutionError(f"of the laws {laws} none takes a restitution, got {restitution!r}; leave it out")


def format_table(table: pd.DataFrame) -> str:
    """Return the table for the screen, with short numbers, and below it refusals, the laws in full, and a caution."""
    shown = table.drop(columns=["law", "refused"]).copy()
    shown["v+"] = [_short(v) for v in table["v+"]]
    shown["T+/T-"] = table["T+/T-"].astype(float).round(4) + 0.0
    antidissipative = table["antidissipative"].fillna("")
    shown["antidissipative"] = [_first(labels.split(_BETWEEN) if labels else []) for labels in antidissipative]
    formats = {
        "events": "{:.0f}",
        "T+/T-": "{:.4f}",
        "distance from S": "{:.1e}",
        "energy kept": "{:.6f}",
        "penetration": "{:.1e}",
        "us/step": "{:.0f}",
    }
    for column, pattern in formats.items():
        shown[column] = ["" if pd.isna(x) else pattern.format(x) for x in shown[column]]
    text = shown.fillna("").to_string(index=False)
    for run, reason in zip(table["run"], table["refused"], strict=True):
        if reason:
            text += f"\n{run} was refused: {reason}"
    laws = zip(table["run"], table["law"], strict=True)
    text += "\n\nlaws: " + ", ".join(f"{run} = {law}" for run, law in laws if isinstance(law, str))
    rows = zip(table["law"], table["T+/T-"], strict=True)
    return f"{text}\n{_SOFT}" if any(not isinstance(law, str) and pd.notna(ratio) for law, ratio in rows) else text


def _short(values: list[float] | None) -> str:
    if values is None:
        return ""
    moving = ", ".join(f"{0.0 if abs(v) < 5e-5 else v:.4g}" for v in values[:_WIDTH])
    return f"({moving}{', ...' if len(values) > _WIDTH else ''})"


def _first(names: Sequence[str]) -> str:
    return f"{names[0]} and {len(names) - 1} more" if len(names) > 1 else "".join(names)


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise SceneError(f"{name} must be a positive number of seconds, got {value}")
    return value


def _steps(duration: float, timestep: float) -> int:
    """Return the number of steps; raise `SceneError` if it would be 0 or far too many."""
    if _positive("duration", duration) < timestep:
        raise SceneError(f"duration must be a timestep, {timestep:g} s, or more, got {duration:g} s")
    if duration / timestep > _MOST_STEPS:
        raise SceneError(f"duration {duration:g} s takes more than {_MOST_STEPS:g} timesteps of {timestep:g} s")
    return round(duration / timestep)


def tabulate(runs: Sequence[Run]) -> pd.DataFrame:
    """Return one row per run.

    Columns: run; its law, None for MuJoCo's contacts; velocity after the first collision; T+/T- there; admissible
    (yes, or the violations and their sizes, sqrt(J)); distance of the outcome from S(v-), sqrt(J), if contacts have no
    friction; antidissipative contacts; energy kept over the whole run (potential energy counted from its lowest value
    in any run); deepest penetration, m; number of events; number of steps with too many events to locate; time per
    step, microseconds; reason of a refusal.
    """
    lowest = min(float(run.potential.min()) for run in runs)
    return pd.DataFrame([_row(run, lowest) for run in runs])


def _row(run: Run, lowest: float) -> dict[str, object]:
    begin, end = (run.kinetic[i] + run.potential[i] - lowest for i in (0, -1))
    row: dict[str, object] = {"run": run.name, "law": run.law}
    row |= dict.fromkeys(("v+", "T+/T-", "admissible", "distance from S", "antidissipative"))
    if run.first is not None:
        impact, collision = run.first, run.first.collision
        row["v+"] = [float(v) for v in impact.post_velocity]
        row["T+/T-"] = 1.0 + impact.energy_change / collision.kinetic_energy
        row["admissible"] = "yes" if impact.violations.is_admissible() else str(impact.violations)
        if collision.has_admissible_set:
            row["distance from S"] = collision.admissible_set.distance(impact.post_velocity)
        row["antidissipative"] = _BETWEEN.join(compress(collision.labels, impact.antidissipative))
    return row | {
        "energy kept": end / begin if begin > 0 else 1.0,
        "penetration": max(0.0, -run.deepest),
        "events": run.events,
        "unlocated": run.unlocated,
        "us/step": 1e6 * run.seconds_per_step,
        "refused": run.refusal,
    }
