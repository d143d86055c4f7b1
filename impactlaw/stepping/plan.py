"""The plan of a step: which optional parts the scene needs, derived from the compiled model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from impactlaw.scene.contacts import geom_names
from impactlaw.scene.equality_constraints import bilateral_constraints
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.pairs import GeomPairs, geom_pairs, one_contact, several_contacts, thickness, touching_distance

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_HINGE, _SLIDE, _FREE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("HINGE", "SLIDE", "FREE"))
_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)


@dataclass(frozen=True)
class Part:
    """One part of a step."""

    name: str  # what it does
    runs: bool  # whether it runs in this scene
    why: str  # the fact about the scene that decides


@dataclass(frozen=True)
class Plan:
    """Which parts of a step the scene needs; steps leave out the parts whose flag is False."""

    contact_model: Literal["rigid", "soft"]  # "rigid" or "soft"
    # "event-driven" or "time-stepping" for rigid stepping; None for soft stepping
    scheme: Literal["event-driven", "time-stepping"] | None
    limits: bool  # joints or tendons have limits, which are contacts like any other
    detection: bool  # collision detection: some geoms can meet
    convex: bool  # exact settings of MuJoCo's general convex collider, which measures some pairs
    faces: bool  # a second detection, to find several contacts between faces of cylinders and meshes
    points: bool  # matching contact points from phase to phase: some pairs have several contacts
    passing: bool  # the check that no body passes through another: some bodies can meet others that are not planes
    # a bound on rotation within a smooth phase: some bodies that can meet others, or planes, are not round
    turning: bool
    bilateral: bool  # equality constraints that no impulse may violate
    friction: bool  # some contacts have friction; in soft stepping it acts in collisions
    surfaces: bool  # surfaces that move by themselves: some mocap bodies, or belts with friction, can meet others
    inertia: bool  # a new factor of the mass matrix at every collision: it depends on the configuration
    rest: bool  # the contact forces of a step in which nothing moved are tried again in the next step
    pairs: GeomPairs = field(repr=False, compare=False)  # pairs of geoms that can meet
    parts: tuple[Part, ...] = field(repr=False, compare=False)  # the same plan with reasons, for people to read


def make_plan(
    model: mujoco.MjModel,
    contact_model: Literal["rigid", "soft"] = "rigid",
    *,
    scheme: Literal["event-driven", "time-stepping"] | None = None,
    friction: Literal["coulomb", "convex", "ignore"] = "coulomb",
) -> Plan:
    """Return the plan for the compiled model and these options of a `Stepper`."""
    pairs = geom_pairs(model)
    geoms = pairs.geoms
    thin = thickness(model)
    solid = geoms[np.isfinite(thin[geoms]).all(axis=1)]
    several = ~one_contact(model, geoms)
    rigid = contact_model == "rigid"
    located = rigid and scheme != "time-stepping"
    flags = {
        "limits": bool(Limits(model)),
        "detection": len(geoms) > 0 or (not rigid and model.nflex > 0),
        "convex": located and bool((touching_distance(model, geoms) > 0).any()),
        "faces": located and bool(several_contacts(model, geoms).any()),
        "points": located and bool(several.any()),
        "passing": located and len(solid) > 0,
        "turning": located and bool((model.geom_rbound[geoms] > thin[geoms]).any()),
        "bilateral": bool(bilateral_constraints(model).any()),
        "friction": friction != "ignore" and bool(pairs.friction.any()),
        "surfaces": bool(_moves(model, geoms).any() or (pairs.friction & _runs(model, geoms)).any()),
        "inertia": (len(geoms) > 0 or bool(Limits(model))) and not has_constant_inertia(model),
    }
    given = flags["bilateral"] or model.tendon_limited.any()
    flags["inertia"] &= located or not rigid
    flags["rest"] = located and (flags["detection"] or flags["limits"]) and not given
    reasons = _Reasons(model, pairs, flags)
    parts = tuple(reasons.soft() if not rigid else reasons.rigid() if located else reasons.time_stepping())
    scheme = (scheme or "event-driven") if rigid else None
    return Plan(contact_model=contact_model, scheme=scheme, **flags, pairs=pairs, parts=parts)


def _moves(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return which pairs of geoms include a geom on a mocap body, bool (p,)."""
    return (model.body_mocapid[model.body_rootid[model.geom_bodyid[geoms]]] >= 0).any(axis=1)


def _runs(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return which pairs of geoms include a geom whose surface runs like a belt, bool (p,).

    MuJoCo ignores `geom_surfacevel` in a model that was compiled without belts.
    """
    return bool(model.flg_surfacevel) & model.geom_surfacevel.any(axis=1)[geoms].any(axis=1)


def format_plan(plan: Plan) -> str:
    """Return the plan as lines of text; the parts that run come first."""
    width = max(len(part.name) for part in plan.parts)
    parts = sorted(plan.parts, key=lambda part: not part.runs)
    return "\n".join(f"{'runs    ' if part.runs else 'left out'}  {part.name:<{width}}  {part.why}" for part in parts)


@dataclass(frozen=True)
class _Reasons:
    """Explains in words why each part runs or is left out."""

    model: mujoco.MjModel
    pairs: GeomPairs
    flags: dict[str, bool]

    def rigid(self) -> Iterator[Part]:
        model, geoms = self.model, self.pairs.geoms
        yield self._detection()
        rk4 = model.opt.integrator == _RK4
        stages = "once, at the end of a smooth phase" if rk4 else "the integrator has one stage"
        yield Part("collision detection at every stage of the integrator", False, stages)
        convex, flat = touching_distance(model, geoms) > 0, several_contacts(model, geoms)
        many = ~one_contact(model, geoms)
        thin = f"the thinnest pair measures {2 * thickness(model)[geoms].sum(axis=1).min(initial=np.inf):.3g} m"
        turns = "some bodies that can meet others, or planes, are not round"
        for part in (
            ("convex", "exact settings for general convex shapes", convex, "distances of all pairs have closed forms"),
            ("faces", "second detection, for several contacts between faces", flat, "no cylinder or mesh meets a face"),
            ("points", "matching of contact points from phase to phase", many, "no pair has more than one contact"),
            ("passing", "check that nothing passes through another body", thin, "bodies meet planes only"),
            ("turning", "bound on rotation within a smooth phase", turns, "all that can meet is round"),
        ):
            yield self._part(*part)
        yield self._solver()
        name, why = "new factor of the mass matrix at every collision", "the mass matrix depends on the configuration"
        yield self._part("inertia", name, why, "the mass matrix is constant: factored once")
        name, why = "trial of the last contact forces, for scenes at rest", "equality constraints or limits of tendons"
        yield self._part("rest", name, "contacts are not looked at, nor forces solved for, while it lasts", why)
        yield from self._mujoco()
        yield from self._friction()
        yield Part("copies for events and logs", False, "made when something collides")

    def time_stepping(self) -> Iterator[Part]:
        yield self._detection()
        once = "one look at contacts, one problem for all of them, every step"
        yield Part("location of collisions in time", False, once)
        rk4 = self.model.opt.integrator == _RK4
        yield Part("stages of the integrator", False, "RK4 becomes the midpoint rule" if rk4 else "it has one")
        yield self._solver()
        yield from self._mujoco()
        yield from self._friction()
        yield Part("events", False, "resolved when they are read")

    def _friction(self) -> Iterator[Part]:
        geoms = self.pairs.geoms
        friction = int(np.count_nonzero(self.pairs.friction))
        runs = self.flags["friction"]
        why = f"{friction} of {len(geoms)} pairs" if runs else f"ignored on {friction} pairs"
        yield Part("friction", runs, why if friction else "no pair has friction")
        moves = _moves(self.model, geoms) | _runs(self.model, geoms)
        why_not = "no mocap body collides, and no belt has friction"
        if self.model.geom_surfacevel.any() and not self.model.flg_surfacevel:
            why_not = "the model was compiled without surfacevel: as in MuJoCo, what was written there later is ignored"
        yield self._part("surfaces", "moving surfaces", moves, why_not)

    def soft(self) -> Iterator[Part]:
        yield self._detection()
        rk4 = self.model.opt.integrator == _RK4
        why = "RK4's stages look ahead" if rk4 else "the integrator evaluates forces at the start of the step only"
        yield Part("second look at the end of a step that met new contacts", rk4 and self.flags["detection"], why)
        yield self._solver()
        yield from self._mujoco()
        yield from self._friction()
        yield Part("sustained contact and its friction", False, "MuJoCo's own")

    def _part(self, flag: str, name: str, why: str | np.ndarray, why_not: str) -> Part:
        """Return a part with the reason why it runs, which may be the pairs that need it, bool (p,), or why not."""
        if not self.flags[flag]:
            return Part(name, False, why_not if self.flags["detection"] else "no two geoms can meet")
        if isinstance(why, np.ndarray):
            geoms, names = self.pairs.geoms, geom_names(self.model)
            a, b = geoms[int(np.argmax(why))]
            why = f"{int(np.count_nonzero(why))} of {len(geoms)} pairs, {names[a]}/{names[b]} among them"
        return Part(name, True, why)

    def _detection(self) -> Part:
        n = len(self.pairs.geoms)
        if self.flags["detection"] and not n:
            return Part("collision detection", True, "a flex can collide")
        if self.model.opt.disableflags & _NO_CONTACT:
            return Part("collision detection", False, "the scene's options disable contact")
        why = f"{n} pair{'s' if n > 1 else ''} of geoms can meet" if n else "no two geoms can meet"
        return Part("collision detection", n > 0, why)

    def _solver(self) -> Part:
        name = "solver for several contacts at once"
        geoms = self.pairs.geoms
        limits = len(Limits(self.model).names)
        if limits + len(geoms) == 1 and (limits or one_contact(self.model, geoms)[0]):
            return Part(name, False, "at most one contact: closed form")
        some = limits + len(geoms) > 0
        return Part(name, some, "more than one contact can collide" if some else "no contact")

    def _mujoco(self) -> Iterator[Part]:
        m = self.model
        limits = len(Limits(m).names)
        for name, n, what in (
            ("limits as contacts", limits, "of the joints and tendons"),
            ("equality constraints", int(np.count_nonzero(m.eq_active0)), "active: impulses leave them alone"),
            ("tendons", int(m.ntendon), "tendons"),
            ("actuators", int(m.nactuator), "actuators"),
        ):
            yield Part(name, n > 0, f"{n} {what}" if n else "none")


def has_constant_inertia(model: mujoco.MjModel) -> bool:
    """Return whether the mass matrix is the same in every configuration.

    It is constant if each tree of bodies has slide joints only, or a single joint that is either a hinge or a free
    joint of a body with its center of mass in its origin.
    """
    if model.tendon_armature.any() or model.actuator_armature[model.actuator_trntype == _TENDON].any():
        return False
    root = model.body_rootid[model.jnt_bodyid]
    for tree in np.unique(root):
        kinds = model.jnt_type[root == tree]
        alone = len(kinds) == 1
        centered = alone and kinds[0] == _FREE and _is_centered(model, tree)
        if not ((kinds == _SLIDE).all() or (alone and kinds[0] == _HINGE) or centered):
            return False
    return True


def _is_centered(model: mujoco.MjModel, root: int) -> bool:
    """Return whether the center of mass of a tree without inner joints is at the origin of its root body."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return bool(np.abs(data.subtree_com[root] - data.xpos[root]).max() <= 1e-15 + 1e-12 * model.stat.extent)
