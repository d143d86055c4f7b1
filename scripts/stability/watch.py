"""Steps a scene and measures it by means of MuJoCo and of the study, not of the package."""

import time
from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw import FrictionImpact, ImpactEvent, Law, MaximalDissipation, Moreau, Newton, Stepper
from scripts.robots.watch import Seen
from scripts.robots.watch import Watch as States

from .certificate import Sliding, certify
from .verdicts import Measurement

G = 9.81
FLOOR = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'
MOST = 100  # largest number of collisions per step; beyond it rigid steps are time stepped, soft ones end with E = 0
_EXTENDED = 64  # largest number of velocities of collisions that are checked in extended precision, which is slow
_ROUNDING = 16 * float(np.finfo(float).eps)  # of contact velocities, relative to the fastest contact of the run


def coefficient(law: str) -> float:
    """Return the coefficient e of a law, given its name in the table."""
    return 0.0 if law == "maximal-dissipation" else float(law.split()[-1])


def law_of(law: str) -> Law:
    """Return a law for any number of contacts, given its name in the table: maximal-dissipation, or kind and e."""
    if law == "maximal-dissipation":
        return MaximalDissipation()
    return {"moreau": Moreau, "newton": Newton}[law.split()[0]](coefficient(law))


def compiled(
    world: str, rest: str = "", *, timestep: float = 2e-3, gravity: float = G, integrator: str = "RK4"
) -> mujoco.MjModel:
    """Compile a scene from the MJCF of its world and of other sections."""
    option = f'<option gravity="0 0 {-gravity}" timestep="{timestep!r}" integrator="{integrator}"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{world}</worldbody>{rest}</mujoco>")


class Watch:
    """Steps a scene and keeps the largest errors.

    After every step MuJoCo's own detection, on a copy of the scene, measures how deep geoms overlap, and MuJoCo's
    energies show how much the scene has gained since their minimum. The study certifies every collision. Steps with
    more collisions than the stepper may locate are time stepped and counted; their errors are kept separately.

    Args:
        model: the scene.
        law: name of the law.
        contact_model: "rigid" or "soft".
        gap_tolerance: gap tolerance of rigid stepping, m.
        every: number of steps between measurements of penetration and energy.
        size: size of the moving bodies, m; depths in steps that are time stepped are relative to it.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: str,
        *,
        contact_model: Literal["rigid", "soft"] = "rigid",
        gap_tolerance: float = 1e-9,
        every: int = 1,
        size: float = 0.1,
    ):
        self.model, self.data = model, mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self.data, 0)
        self._law = law
        options: dict[str, Any] = {"gap_tolerance": gap_tolerance} if contact_model == "rigid" else {}
        self._stepper = Stepper(model, law_of(law), contact_model=contact_model, max_events=MOST, **options)
        self._every, self._size = every, size
        self._states = States(model, tolerance=1e-12)
        self.residual = self.penetration = self.deviation = self.first_order = self.gain = self.slowest = 0.0
        self.steps = self.collisions = self.scaled = 0
        self._fastest = 0.0
        self._lowest = np.inf

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """Collisions of the last step."""
        return self._stepper.events

    @property
    def unlocated(self) -> int:
        """Number of steps that were time stepped, completely or in part."""
        return self._stepper.unlocated

    def step(self, steps: int = 1) -> None:
        """Advance and measure."""
        if self.steps == 0:
            self._look()
        for _ in range(steps):
            located, begun = self.unlocated, time.perf_counter()
            self._stepper.step(self.data)
            self.slowest = max(self.slowest, time.perf_counter() - begun)
            self.steps += 1
            errors = [self._certify(event, final=number >= MOST) for number, event in enumerate(self.events)]
            depth = self._look() if self.steps % self._every == 0 else 0.0
            if self.unlocated > located:
                parts = [error * (speed / self._fastest if speed else 1.0) for error, speed in errors]
                self.first_order = float(np.max([self.first_order, depth / self._size, *parts]))
                continue
            worst = [error for error, _ in errors]
            self.residual, self.penetration = float(np.max([self.residual, *worst])), max(self.penetration, depth)

    def seen(self) -> Seen:
        """Return depth and energy of the current state, by MuJoCo's own detection on a copy of the scene."""
        return self._states.look(self.data, self.data.qpos, self.data.qvel)

    def equality_error(self) -> float:
        """Return the largest violation of an equality constraint in the state that was seen last, m or rad."""
        own = self._states.data
        rows = own.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        return float(np.abs(own.efc_pos[rows]).max(initial=0.0))

    def deviates(self, distance: float) -> None:
        """Keep the largest distance from the closed form; NaN is kept, too."""
        self.deviation = float(np.maximum(self.deviation, distance))

    def rest(self, steps: int) -> None:
        """Advance a scene at rest; every motion, m, and the velocity at the end, m/s, counts as deviation."""
        start = self.data.qpos.copy()
        for _ in range(steps):
            self.step()
            self.deviates(float(np.abs(self.data.qpos - start).max()))
        self.deviates(float(np.abs(self.data.qvel).max()))

    def measurement(self, *, energy: float | None = None, energy_scale: float = 1.0, note: str = "") -> Measurement:
        """Return the measurement; the energy error is the largest gain unless another error is given."""
        energy = self.gain / energy_scale if energy is None else energy
        if not (np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()):
            energy = np.nan
        if self.unlocated:
            note = "; ".join(filter(None, [note, f"{self.unlocated} of {self.steps} steps time stepped"]))
        return Measurement(
            self.residual, energy, self.penetration, self.deviation, self.first_order, self.collisions, note
        )

    def _look(self) -> float:
        """Keep the largest gain of energy, and return the depth of the deepest overlap of geoms, m."""
        seen = self.seen()
        self._lowest = min(self._lowest, seen.energy)
        self.gain = float(np.maximum(self.gain, seen.energy - self._lowest))
        return seen.depth

    def _certify(self, event: ImpactEvent, *, final: bool) -> tuple[float, float]:
        """Count a collision, and return its largest error and the speed of its fastest contact, m/s."""
        impact, c = event.impact, event.impact.collision
        kind = np.longdouble if len(c.pre_velocity) <= _EXTENDED else float
        w, after = c.surface_velocity, c.post_surface_velocity
        w = np.zeros(len(c.labels)) if w is None else w
        gamma = c.jacobian @ c.pre_velocity + w
        speed = float(np.abs(gamma).max(initial=0.0))
        self._fastest = max(self._fastest, speed)
        wanted = -(0.0 if final else coefficient(self._law)) * gamma
        sliding = None
        if isinstance(impact, FrictionImpact) and c.friction is not None:
            f = c.friction
            rows = f.jacobian, f.contact, f.coefficient
            sliding = Sliding(*rows, impact.friction_impulse, f.surface_velocity, f.post_surface_velocity)
            if impact.restitution_scale < 1.0:
                wanted = np.where(wanted > 0, impact.restitution_scale * wanted, wanted)
                self.scaled += 1
        numbers = c.mass_matrix, c.jacobian, c.pre_velocity, impact.post_velocity, impact.impulse, wanted
        surfaces = w, w if after is None else after
        others = {"surfaces": surfaces, "sliding": sliding, "rounding": _ROUNDING * self._fastest, "kind": kind}
        found = certify(*numbers, bilateral=c.bilateral_jacobian, **others)
        self.collisions += 1
        return float(max(found.residual, found.balance, found.penetration, found.change)), speed


def bounce(time: float, e: float, height: float, gravity: float) -> float:
    """Return the height of a ball dropped from ``height`` after ``time``, m, in closed form."""
    fall = np.sqrt(2.0 * height / gravity)
    if time < fall:
        return height - 0.5 * gravity * time**2
    start, speed = fall, e * gravity * fall
    while speed > 1e-13 * gravity * fall:
        flight = 2.0 * speed / gravity
        if time < start + flight:
            return speed * (time - start) - 0.5 * gravity * (time - start) ** 2
        start, speed = start + flight, e * speed
    return 0.0
