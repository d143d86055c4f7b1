"""One scripted controller per environment, tuned to one impact law, and its score under others.

Each controller knows the mechanics of its task and one law, and acts on observations only. Its score is the mean return
of an episode; an environment counts as solved from the ``reward_threshold`` of its registration on. The same episodes
(seeds) are played under every law, so that the law alone makes the difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
import pandas as pd
import tyro
from tqdm import tqdm

from impactlaw.envs import billiards, juggler, newtons_cradle, rocking_block

Controller = Callable[[np.ndarray], float | tuple[float, float]]
GRAVITY = 9.81

LAWS: dict[str, tuple[tuple[str, float | None], ...]] = {
    "NewtonsCradle-v0": (
        ("reversal", 1.0),
        ("reversal", 0.8),
        ("moreau", 1.0),
        ("moreau", 0.5),
        ("maximal-dissipation", None),
    ),
    "Juggler-v0": (
        ("newton", 0.8),
        ("newton", 1.0),
        ("newton", 0.9),
        ("newton", 0.5),
        ("maximal-dissipation", None),
    ),
    "Billiards-v0": (
        ("moreau", 0.95),
        ("moreau", 0.8),
        ("moreau", 0.5),
        ("maximal-dissipation", None),
        ("reversal", 0.95),
    ),
    "RockingBlock-v0": (
        ("moreau", 0.0),
        ("moreau", 0.5),
        ("moreau", 1.0),
        ("reversal", 0.8),
        ("reversal", 1.0),
    ),
}
"""Laws that a controller is played under; it is tuned to the first one."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Scores of the scripted controllers under several laws."""

    episodes: int = 10
    """Episodes per environment and law."""
    seed: int = 0
    """Seed of the first episode; the others count up."""
    environments: tuple[str, ...] = tuple(LAWS)
    """Which environments."""


def run(study: Study, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Play all episodes and return one row per environment and law.

    Columns: environment, law, restitution, tuned (whether the controller was), score (mean return), lowest, highest,
    threshold, solved.
    """
    rows = []
    for name in study.environments:
        for i, (law, restitution) in enumerate(LAWS[name]):
            returns = []
            for episode in range(study.episodes):
                returns.append(play(name, law, restitution, study.seed + episode))
                progress()
            threshold = gymnasium.spec(f"impactlaw/{name}").reward_threshold
            assert threshold is not None
            score = float(np.mean(returns))
            rows.append(
                {
                    "environment": name,
                    "law": law,
                    "restitution": restitution,
                    "tuned": i == 0,
                    "score": score,
                    "lowest": min(returns),
                    "highest": max(returns),
                    "threshold": threshold,
                    "solved": score >= threshold,
                }
            )
    return pd.DataFrame(rows)


def play(name: str, law: str, restitution: float | None, seed: int, controller: Controller | None = None) -> float:
    """Play one episode and return the sum of its rewards.

    Args:
        name: of the environment, without namespace.
        law: that the environment is under.
        restitution: of that law.
        seed: of the episode.
        controller: the one tuned to the environment's first law if not given.
    """
    controller = CONTROLLERS[name]() if controller is None else controller
    env = gymnasium.make(f"impactlaw/{name}", law=law, restitution=restitution)
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(np.atleast_1d(controller(observation)))
        total += float(reward)
        over = terminated or truncated
    env.close()
    return total


class OnePull:
    """Cradle: pull the first ball to the target's height, wait until it hangs still, let go for good.

    Tuned to "reversal" with e = 1, which hands the height on.
    """

    def __init__(self) -> None:
        self._released = False

    def __call__(self, observation: np.ndarray) -> float:
        """Return the pull."""
        angle, speed, target = -observation[0], -observation[5], observation[10]
        wanted = np.arccos(1.0 - target / newtons_cradle.LENGTH)
        self._released |= abs(angle - wanted) < 1e-3 and abs(speed) < 1e-2
        if self._released:
            return -1.0
        hold = GRAVITY * np.sin(wanted)
        return (hold + 20.0 * (wanted - angle) - 8.0 * speed) / newtons_cradle.PULL


@dataclass(frozen=True)
class Hit:
    """Juggler: meet the ball at the middle of the stroke with the speed that sends it to the target's height.

    Attributes:
        restitution: e that it is tuned to.
        acceleration: with which the paddle gains that speed, m/s^2.
        dt: duration of a step, s.
    """

    restitution: float = 0.8
    acceleration: float = 40.0
    dt: float = 0.01

    def __call__(self, observation: np.ndarray) -> float:
        """Return the acceleration."""
        height, velocity, place, speed, target = observation
        arrival = np.sqrt(max(0.0, velocity**2 + 2.0 * GRAVITY * height))
        time = (velocity + arrival) / GRAVITY
        leaving = np.sqrt(2.0 * GRAVITY * target)
        hit = (leaving - self.restitution * arrival) / (1.0 + self.restitution)  # v+ = e arrival + (1 + e) hit
        left = min(time - self.dt, abs(hit) / self.acceleration)  # time to gain speed, after this step
        a = np.copysign(self.acceleration, hit)
        next_place, next_speed = 0.5 * a * left**2 - hit * left, hit - a * left
        wanted = (next_speed + 15.0 * (next_place - place - self.dt * speed) - speed) / self.dt
        return wanted / juggler.DRIVE.acceleration


@dataclass(frozen=True)
class FullHit:
    """Billiards: hit the rack's first ball full, at the speed with which its neighbours just reach the corners.

    Attributes:
        restitution: e of Moreau's law that it is tuned to; the balls leave with ``(1 + e) p``.
    """

    restitution: float = 0.95

    def __call__(self, observation: np.ndarray) -> tuple[float, float]:
        """Return angle and speed."""
        contact = observation[2] - 0.0625, observation[3]  # of the cue ball's centre, one diameter before ball 1
        angle = np.arctan2(contact[1] - observation[1], contact[0] - observation[0])
        speed = 6.6 / (1.0 + self.restitution)
        slow, fast = billiards.SPEED
        return angle / billiards.WIDEST_AIM, 2.0 * (speed - slow) / (fast - slow) - 1.0


@dataclass(frozen=True)
class Save:
    """Rocking block: tilt the platform along with a block that has the energy to topple; leave the rest to impacts.

    Tuned to e = 0, where each change of foot takes half of the energy.

    Attributes:
        enough: part of the energy to topple from which it acts.
        lead: time by which it looks ahead, s.
        frequency: with which the platform follows, rad/s.
    """

    enough: float = 0.8
    lead: float = 0.06
    frequency: float = 19.0

    def __call__(self, observation: np.ndarray) -> float:
        """Return the acceleration."""
        tilt, _, angle, turn, _, spin = observation
        falls = angle * spin > 0 and self._energy(abs(angle), spin) >= self.enough
        wanted = angle + self.lead * spin if falls else 0.0
        acceleration = self.frequency**2 * (wanted - tilt) - 1.26 * self.frequency * turn
        return acceleration / rocking_block.DRIVE.acceleration

    @staticmethod
    def _energy(angle: float, spin: float) -> float:
        b, h = rocking_block.HALF_WIDTH, rocking_block.HALF_HEIGHT
        inertia = (b**2 + h**2) / 3.0
        rise = b * np.sin(angle) + h * (np.cos(angle) - 1.0)
        slope = b * np.cos(angle) - h * np.sin(angle)
        return (rise + (inertia + slope**2) * spin**2 / (2.0 * GRAVITY)) / (np.hypot(b, h) - h)


CONTROLLERS: dict[str, Callable[[], Controller]] = {
    "NewtonsCradle-v0": OnePull,
    "Juggler-v0": Hit,
    "Billiards-v0": FullHit,
    "RockingBlock-v0": Save,
}


def format_table(table: pd.DataFrame) -> str:
    """Return the table in Markdown; the law that the controller is tuned to is marked."""
    lines = ["| environment | law | e | score | lowest .. highest | solved from |", "|---|---|---|---|---|---|"]
    for row in table.to_dict("records"):
        law = f"**{row['law']}** (tuned)" if row["tuned"] else row["law"]
        e = "" if pd.isna(row["restitution"]) else f"{row['restitution']:g}"
        span = f"{row['lowest']:.3g} .. {row['highest']:.3g}"
        solved = f"{row['threshold']:g}, solved" if row["solved"] else f"{row['threshold']:g}"
        lines.append(f"| {row['environment']} | {law} | {e} | {row['score']:.3g} | {span} | {solved} |")
    return "\n".join(lines)


def main(study: Study, csv: Path | None = None) -> None:
    """Print the table.

    Args:
        study: what to play.
        csv: also write the table to this file.
    """
    total = study.episodes * sum(len(LAWS[name]) for name in study.environments)
    with tqdm(total=total, unit="episode", disable=None) as bar:
        table = run(study, bar.update)
    print(format_table(table))
    if csv is not None:
        table.to_csv(csv, index=False)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
