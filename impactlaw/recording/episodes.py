"""Episodes of a recording: write and read their starts, and the action and reward of every environment step."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlaw.errors import RecordingError
from impactlaw.recording import layout
from impactlaw.recording.layout import Column, time_columns

if TYPE_CHECKING:
    import pandas as pd

    from impactlaw.recording.rrd import Entity


class EpisodeMarks:
    """A buffer of episode starts, changes of law and model, and environment steps since the last `send`."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[float, int, dict[str, Any]]]] = {path: [] for path in layout.MARKED}

    def add(self, path: str, clock: float, frame: int, cells: dict[str, Any]) -> None:
        """Add a row to an entity; ``clock`` is the time of its frame on the timeline, s."""
        self._rows[path].append((clock, frame, cells))

    def end_step(self, clock: float, frame: int, action: Any, reward: Any, ended: tuple[bool, bool]) -> None:
        """Add an environment step that ends with this frame."""
        terminated, truncated = ended
        try:
            told = np.asarray(action)
            numbers, gained = _as_floats(told), float(reward)
        except (TypeError, ValueError):
            raise RecordingError(
                f"a recording takes real numbers as an action, whole ones up to 2^53, got {action!r:.100}, and one "
                f"number as a reward, got {reward!r:.100}: put a wrapper around the environment, inside of what "
                "records, that makes them so"
            ) from None
        step = {
            "action": numbers.tolist(),
            "kind": json.dumps([told.dtype.str, told.shape]),
            "reward": gained,
            "terminated": bool(terminated),
            "truncated": bool(truncated),
        }
        self.add(layout.STEPS, clock, frame, step)

    def send(self, stream: Any) -> None:
        """Send the buffered rows to a rerun stream, and clear the buffer."""
        for path, rows in self._rows.items():
            if rows:
                (kind, names), (clocks, frames, cells) = layout.MARKED[path], zip(*rows, strict=True)
                columns = [Column(f"{kind}:{name}", what, [c[name] for c in cells]) for name, what in names.items()]
                stream.send_columns(path, time_columns(clocks, frames), columns, strict=True)
                rows.clear()


def _as_floats(told: np.ndarray) -> np.ndarray:
    """Return numbers as a flat float64 array; raise ValueError if it cannot represent them exactly."""
    if told.dtype.kind not in "biuf":
        raise TypeError
    numbers = told.ravel().astype(float)
    if told.dtype.kind in "iu":
        with np.errstate(invalid="ignore"):
            if (numbers.astype(told.dtype) != told.ravel()).any():
                raise ValueError
    return numbers


@dataclass(frozen=True, eq=False)
class LawChange:
    """A law that was set within an episode.

    Attributes:
        step: environment step from which the law is in force, counted from 0 in the episode.
        frame: first frame of the episode under the law.
        law: the law as text.
        value: the law as plain values, which can be assigned to ``env.law``; None if it could not be written so.
    """

    step: int
    frame: int
    law: str
    value: Any


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of a recording; `impactlaw.envs.restart` resets an environment to its start.

    Attributes:
        number: number of the episode.
        seed: seed of the reset; None if it had no seed.
        generator: state of the environment's random generator before the reset; None if unknown.
        law: the law at the start, as text; None if unknown.
        settings: law and options of stepping at the start, as accepted by ``reset(options=...)``; empty if unknown.
        time: times of the frames, s, (n,): the start of the episode, and the end of every timestep.
        qpos: positions, (n, nq).
        qvel: velocities, (n, nv).
        actions: one action per environment step, in its own type and shape, (k, ...), or as objects, (k,), if these
            differ between steps; empty if no environment steps were recorded.
        rewards: rewards, (k,).
        frame: last frame of each environment step, int (k,).
        ended: "terminated", "truncated", or "" if the episode was abandoned or ended by a wrapper outside the recorded
            environment.
        scene: name of the environment, or of the scene; None if unknown.
        contact_model: "rigid" or "soft"; None if unknown.
        made: how the environment stepped first, by names of options; empty if unknown.
        law_changes: laws that were set within the episode, in order.
        model_changes: environment steps, counted from 0, before which the model was changed within the episode.
        state_changes: environment steps, counted from 0, before which the state was changed within the episode, by hand
            or by an environment step that raised an error after some of its timesteps.
    """

    number: int
    seed: int | None
    generator: dict[str, Any] | None
    law: str | None
    settings: dict[str, Any]
    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    frame: np.ndarray
    ended: str = ""
    scene: str | None = None
    contact_model: str | None = None
    made: dict[str, Any] = field(default_factory=dict)
    law_changes: tuple[LawChange, ...] = ()
    model_changes: tuple[int, ...] = ()
    state_changes: tuple[int, ...] = ()


def read_episodes(entities: dict[str, Entity], time: np.ndarray, scene: str | None) -> tuple[Episode, ...]:
    """Return the episodes of a recording.

    If the recording holds no starts of episodes, an episode begins wherever time does not increase.

    Args:
        entities: the recording.
        time: times of its frames, s, (n,).
        scene: name of its scene.
    """
    n = len(time)
    if not n:
        return ()
    entity = entities.get(layout.EPISODES)
    if entity is None:
        first = np.flatnonzero(np.diff(time, prepend=np.inf) <= 0)
        starts: list[dict[str, Any]] = [{"number": number} for number in range(len(first))]
    else:
        first = entity.step
        cells = {name: entity.cells(f"{layout.EPISODE}:{name}") for name in layout.EPISODE_COLUMNS}
        known = {name: row for name, row in cells.items() if row}  # files of older versions have fewer columns
        starts = [{name: row[i][0] if row[i] else None for name, row in known.items()} for i in range(len(first))]
    ends = np.append(first[1:], n)
    return tuple(
        _episode(entities, time, start | {"scene": scene}, int(begin), int(end))
        for start, begin, end in zip(starts, first, ends, strict=True)
        if begin < n
    )


def _episode(entities: dict[str, Entity], time: np.ndarray, start: dict[str, Any], begin: int, end: int) -> Episode:
    part = slice(begin, min(end, len(time)))
    state, steps = entities.get(layout.STATE), entities.get(layout.STEPS)
    length = len(time[part])
    qpos, qvel = (
        np.zeros((length, 0)) if state is None else state.numbers(name)[: len(time)][part]
        for name in (layout.QPOS, layout.QVEL)
    )
    taken: dict[str, list[Any]] = {name: [] for name in layout.STEP_COLUMNS}
    frame = np.zeros(0, dtype=int)
    if steps is not None:
        mine = np.flatnonzero((steps.step >= begin) & (steps.step < part.stop))
        frame = steps.step[mine] - begin
        for name in layout.STEP_COLUMNS:
            cells = steps.cells(f"{layout.TAKEN}:{name}")
            taken[name] = [cells[i] if name == "action" else cells[i][0] for i in mine]
    made, model_changes = _made(entities.get(layout.MODELS), start.get("made") or "{}", begin, part.stop, frame)
    last = [word for word in ("terminated", "truncated") if taken[word] and taken[word][-1]]
    generator, settings = start.get("generator"), json.loads(start.get("settings") or "{}")
    return Episode(
        number=int(start["number"]),
        seed=start.get("seed"),
        generator=None if generator is None else json.loads(generator),
        law=start.get("law"),
        settings={name: value for name, value in settings.items() if name != "contact_model"},
        time=time[part],
        qpos=qpos,
        qvel=qvel,
        actions=_actions(taken["action"], taken["kind"]),
        rewards=np.array(taken["reward"], dtype=float),
        frame=frame,
        ended=last[0] if last else "",
        scene=start["scene"],
        contact_model=settings.get("contact_model"),
        made=json.loads(made),
        law_changes=_law_changes(entities.get(layout.CHANGES), begin, part.stop, frame),
        model_changes=model_changes,
        state_changes=_state_changes(entities.get(layout.STATES), begin, part.stop, frame),
    )


def _made(entity: Entity | None, made: str, begin: int, end: int, frame: np.ndarray) -> tuple[str, tuple[int, ...]]:
    """Return how the environment took its first step, as JSON, and the steps before which the model was changed later.

    `made` is how it was made at the reset. The other arguments are those of `_law_changes`.
    """
    if entity is None:
        return made, ()
    cells, changes = entity.cells(f"{layout.REMADE}:made"), []
    for i in np.flatnonzero((entity.step >= begin) & (entity.step < end)):
        step = int(np.searchsorted(frame, int(entity.step[i]) - begin))
        if step == 0:
            made = cells[i][0]
        else:
            changes.append(step)
    return made, tuple(changes)


def _state_changes(entity: Entity | None, begin: int, end: int, frame: np.ndarray) -> tuple[int, ...]:
    """Return the environment steps before which the state was changed; the arguments are those of `_law_changes`."""
    if entity is None:
        return ()
    first = entity.step[(entity.step >= begin) & (entity.step < end)] - begin
    return tuple(np.searchsorted(frame, first).tolist())


def _law_changes(entity: Entity | None, begin: int, end: int, frame: np.ndarray) -> tuple[LawChange, ...]:
    """Return the changes of law from frame begin to frame end, an episode whose steps end with the frames in frame."""
    if entity is None:
        return ()
    laws, values = (entity.cells(f"{layout.CHANGE}:{name}") for name in layout.CHANGE_COLUMNS)
    found = []
    for i in np.flatnonzero((entity.step >= begin) & (entity.step < end)):
        first = int(entity.step[i]) - begin
        value = json.loads(values[i][0]) if values[i] else None
        found.append(LawChange(int(np.searchsorted(frame, first)), first, laws[i][0], value))
    return tuple(found)


def _actions(rows: list[list[float]], kinds: list[str]) -> np.ndarray:
    if not rows:
        return np.zeros((0, 0))
    if len(set(kinds)) > 1:
        actions = np.empty(len(rows), object)
        actions[:] = [_actions([row], [kind])[0] for row, kind in zip(rows, kinds, strict=True)]
        return actions
    dtype, shape = json.loads(kinds[0])
    return np.array([row or [] for row in rows], dtype=float).astype(dtype).reshape(len(rows), *shape)


def episode_table(episodes: tuple[Episode, ...], collisions: pd.DataFrame) -> pd.DataFrame:
    """Return a table with one row per episode.

    Columns: ``episode``, its number; ``seed``; ``law`` at its start; ``frames``; ``steps``, of the environment;
    ``duration``, s; ``return``, the sum of its rewards; ``ended``, see `Episode`; ``collisions``, their number.
    """
    import pandas as pd

    counts = Counter(collisions["episode"].tolist())
    columns = {
        "episode": [e.number for e in episodes],
        "seed": pd.array([e.seed for e in episodes], dtype="Int64"),
        "law": [e.law for e in episodes],
        "frames": [len(e.time) for e in episodes],
        "steps": [len(e.rewards) for e in episodes],
        "duration": [float(e.time[-1] - e.time[0]) for e in episodes],
        "return": [float(e.rewards.sum()) if len(e.rewards) else float("nan") for e in episodes],
        "ended": [e.ended for e in episodes],
        "collisions": [counts[e.number] for e in episodes],
    }
    return pd.DataFrame(columns)
