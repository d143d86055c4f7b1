"""The scenes of the work-precision study, with their laws, references and expected orders."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco

from impactlaw import Fremond, Law, MaximalDissipation, Moreau
from impactlaw.laws.restitution.from_scene import scene_law
from impactlaw.models import load

from . import references, references_friction
from . import scenes_friction as friction
from .graph_distance import Arc

EXACT = 0.0
"""Expected order of a method that is exact up to rounding and the gap tolerance."""


@dataclass(frozen=True)
class Scene:
    """A scene with its law, its reference, and the expected orders of methods on it.

    Attributes:
        name: name in tables.
        load: returns the model and its start.
        law: maps the model to the law.
        duration: simulated time, s.
        reference: maps duration and tolerance to the pieces of the reference trajectory.
        restitution: restitution that MuJoCo's contacts are tuned to.
        smooth_order: order of event-driven RK4 between impacts: `EXACT` where it integrates the flight exactly, two
            where contact is held, and one where contact is held against the damping of joints.
        euler_order: order of event-driven Euler. MuJoCo's Euler is semi-implicit: its positions are those of the
            leapfrog scheme, of order two, where no force acts at the start and at the impacts, as in the cradle.
        time_stepping_order: order of time stepping; two where no impact falls between steps.
        coarsest: largest timestep for the measurement of orders, s; smaller where impacts accumulate.
        smallest: smallest timestep of MuJoCo's tuned contacts, s, so that they run as long as the event-driven runs.
        time_stepping_from: largest timestep for the measurement of the order of time stepping, s. In the cradle under
            the reversal law the balls must touch when they are hit, which larger steps do not ensure.
    """

    name: str
    load: Callable[[], tuple[mujoco.MjModel, mujoco.MjData]]
    law: Callable[[mujoco.MjModel], Law]
    duration: float
    reference: Callable[[float, float], list[Arc]]
    restitution: float | dict[str, float]
    smooth_order: float
    euler_order: float = 1.0
    time_stepping_order: float = 1.0
    coarsest: float = 0.032
    smallest: float = 1e-4
    time_stepping_from: float = 0.016


def _inelastic(_: mujoco.MjModel) -> Law:
    return MaximalDissipation()


_ALL = (
    Scene("bouncing ball", partial(load, "bouncing_ball"), scene_law, 1.2, references.bouncing_ball, 0.5, EXACT,
          smallest=1e-5),
    Scene("cradle, reversal", partial(load, "newtons_cradle"), lambda _: Fremond.reversal(), 2.5,
          references.cradle_reversal, 1.0, 4.0, 2.0, smallest=1e-5, time_stepping_from=1.6e-3),
    Scene("cradle, Moreau", partial(load, "newtons_cradle"), lambda _: Moreau(1.0), 2.5, references.cradle_moreau,
          1.0, 4.0, 2.0, smallest=1e-5),
    Scene("falling rod", partial(load, "falling_rod"), scene_law, 3.0, references.falling_rod,
          {"left": 1.0, "right": 0.0}, 2.0),
    Scene("rocking block", partial(load, "rocking_block"), scene_law, 0.7, references.rocking_block, 0.0, 2.0,
          coarsest=4e-3, smallest=1e-5, time_stepping_from=4e-3),
    Scene("billiard break", partial(load, "billiard_rack"), scene_law, 0.8, references.billiard_break, 0.95, EXACT,
          EXACT),
    Scene("sliding block", friction.sliding_block, _inelastic, 0.5, references_friction.sliding_block,
          {"floor": 0.0}, 2.0, time_stepping_order=2.0, smallest=1e-5),
    Scene("rod with friction", friction.rod, _inelastic, 0.6, references_friction.rod, {"floor": 0.0}, 2.0,
          smallest=1e-5),
    Scene("quadruped", friction.quadruped, _inelastic, 1.0, references_friction.quadruped_landing, {"floor": 0.0},
          1.0, coarsest=4e-3, smallest=1e-5, time_stepping_from=4e-3),
)  # fmt: skip

SCENES = {scene.name: scene for scene in _ALL}
