"""Record collisions: for each one a row of the table, a line in the log and a mark in the scene."""

import math
from collections import Counter
from typing import Any

import mujoco
import numpy as np

from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.recording import layout
from impactlaw.recording.layout import COLLISION_COLUMNS, Column, time_columns
from impactlaw.scene.friction_rows import friction_on_contacts
from impactlaw.stepping.impact_event import ImpactEvent

MARK_TIME = 0.05
"""How long the mark of a collision is shown, in s of simulation time, unless another mark replaces it."""

_NOWHERE = np.zeros((0, 3))


def collision_record(model: mujoco.MjModel, data: mujoco.MjData, event: ImpactEvent) -> dict[str, Any]:
    """Return the cells of a collision by the names of the collision table; `data` is a scratch copy of the state."""
    impact, contacts = event.impact, event.contacts
    violations = impact.violations
    common = {
        "time": float(event.time),
        "contacts": list(contacts.labels),
        "pre_contact_velocity": impact.collision.pre_contact_velocity.tolist(),
        "post_contact_velocity": impact.post_contact_velocity.tolist(),
        "impulse": impact.impulse.tolist(),
        "topology": impact.topology.tolist(),
        "antidissipative": impact.antidissipative.tolist(),
        "position": np.asarray(contacts.position, dtype=float).tolist(),
        "normal": np.asarray(contacts.normal, dtype=float).tolist(),
        "intensity": impact.intensity,
        "induced_impulse": impact.induced_impulse,
        "kinetic_energy": impact.collision.kinetic_energy,
        "energy_change": impact.energy_change,
        "kinematic_violation": violations.kinematic,
        "kinetic_violation": violations.kinetic,
        "energetic_violation": violations.energetic,
        "residual": float(impact.residual),
        "delassus": _delassus(impact.collision),
    }
    return common | _friction(model, data, event) | _moving(event)


def _friction(model: mujoco.MjModel, data: mujoco.MjData, event: ImpactEvent) -> dict[str, Any]:
    impact, rows = event.impact, event.impact.collision.friction
    if not isinstance(impact, FrictionImpact) or rows is None:
        return {}
    data.qpos[:] = event.qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    sliding, _ = friction_on_contacts(
        model, data, event.contacts, contact=rows.contact, jacobian=rows.jacobian, impulse=impact.friction_impulse
    )
    return {
        "friction_contact": rows.contact.tolist(),
        "friction_coefficient": rows.coefficient.tolist(),
        "friction_impulse": impact.friction_impulse.tolist(),
        "pre_sliding_velocity": impact.pre_sliding_velocity.tolist(),
        "post_sliding_velocity": impact.post_sliding_velocity.tolist(),
        "tangential_impulse": sliding.tolist(),
        "restitution_scale": float(impact.restitution_scale),
    }


def _delassus(c: Collision) -> list[float]:
    k = 0 if c.friction is None else len(c.friction)
    if not 0 < len(c.labels) + k <= layout.MOST_COUPLED:
        return []
    rows = np.vstack([c.dense_gradients, c.whitened_friction]) if k else c.dense_gradients
    return (rows @ rows.T).ravel().tolist()


def _moving(event: ImpactEvent) -> dict[str, Any]:
    c: Collision = event.impact.collision
    record: dict[str, Any] = {}
    if c.surface_velocity is not None:
        after = c.surface_velocity if c.post_surface_velocity is None else c.post_surface_velocity
        record |= {"surface_velocity": c.surface_velocity.tolist(), "post_surface_velocity": after.tolist()}
    belts = c.friction is not None and (c.friction.surface_velocity.any() or c.friction.post_surface_velocity.any())
    if c.frame_rates is not None or belts:
        record |= {"surface_work": float(event.impact.surface_work), "pre_speed": float(c.pre_speed)}
    if c.bilateral_jacobian is not None:
        record["bilateral_rows"] = len(c.bilateral_jacobian)
    return record


class CollisionLog:
    """A buffer of collisions since the last `send`.

    Attributes:
        law: the law recorded with collisions, as text; may be changed.
    """

    def __init__(self, model: mujoco.MjModel, law: str, arrow_scale: float):
        self._model, self.law, self._arrow_scale = model, law, arrow_scale
        self._data = mujoco.MjData(model)  # at the configuration of a collision, which differs from those of steps
        self._mark_steps = max(1, math.ceil(MARK_TIME / model.opt.timestep))
        self._count = 0
        self._clear_at: tuple[float, int] | None = None
        self._forget()

    def add(self, event: ImpactEvent, clock: float, *, episode: int, step: int) -> None:
        """Add a collision; ``clock`` is its time on the timeline, s."""
        where = {"index": self._count, "episode": episode, "step": step, "law": self.law}
        record = collision_record(self._model, self._data, event) | where
        self._count += 1
        admissible = event.impact.violations.is_admissible()
        self._rows.append((clock, record, _summary(record, admissible), "INFO" if admissible else "WARN"))
        impulse = event.contacts.normal * event.impact.impulse[:, None]
        if "tangential_impulse" in record:
            impulse = impulse + record["tangential_impulse"]
        self._clear_marks(clock)
        self._marks.append((clock, step, event.contacts.position, self._arrow_scale * impulse))
        self._clear_at = clock + MARK_TIME, step + self._mark_steps

    def send(self, stream: Any, clock: float) -> None:
        """Send the buffered collisions to a rerun stream; ``clock`` is the present time on the timeline, s."""
        import rerun as rr

        self._clear_marks(clock)
        if self._marks:
            clocks, steps, points, arrows = zip(*self._marks, strict=True)
            lengths = [len(part) for part in points]
            points = np.concatenate(points)
            columns = [
                *rr.Points3D.columns(positions=points).partition(lengths),
                *rr.Arrows3D.columns(origins=points, vectors=np.concatenate(arrows)).partition(lengths),
            ]
            stream.send_columns(layout.MARKS, time_columns(clocks, steps), columns, strict=True)
        if self._rows:
            clocks, records, texts, levels = zip(*self._rows, strict=True)
            kinds = COLLISION_COLUMNS | layout.EXTRA_COLUMNS
            cells = {
                name: [record.get(name) for record in records]
                for name in kinds
                if any(name in record for record in records)
            }
            columns = [Column(f"{layout.COLLISION}:{name}", kinds[name], values) for name, values in cells.items()]
            index = time_columns(clocks, cells["step"])
            for name in layout.PLOTTED:
                stream.send_columns(
                    f"{layout.COLLISIONS}/{name}", index, rr.Scalars.columns(scalars=cells[name]), strict=True
                )
            log = rr.TextLog.columns(text=texts, level=levels)
            stream.send_columns(layout.COLLISIONS, index, [*columns, *log], strict=True)
        self._forget()

    def _clear_marks(self, clock: float) -> None:
        if self._clear_at is not None and self._clear_at[0] < clock:
            self._marks.append((*self._clear_at, _NOWHERE, _NOWHERE))
            self._clear_at = None

    def _forget(self) -> None:
        self._rows: list[tuple[float, dict[str, Any], str, str]] = []
        self._marks: list[tuple[float, int, np.ndarray, np.ndarray]] = []


def _summary(record: dict[str, Any], admissible: bool) -> str:
    contacts = Counter(record["contacts"]).items()
    names = ", ".join(f"{count} x {name}" if count > 1 else name for name, count in contacts)
    text = (
        f"{names}: impulse {record['induced_impulse']:.4g} N s, intensity {record['intensity']:.4g} sqrt(J), "
        f"energy {record['energy_change']:+.4g} J"
    )
    if "tangential_impulse" in record:
        text += f", friction {np.linalg.norm(record['tangential_impulse'], axis=1).sum():.4g} N s"
    if "surface_work" in record:
        text += f", work of surfaces {record['surface_work']:+.4g} J"
    if any(record["antidissipative"]):
        text += ", distant effect"
    return text if admissible else text + ", INADMISSIBLE"
