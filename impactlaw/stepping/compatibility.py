"""Checks that a scene and a law fit a way to step, and that options are valid, when a stepper is made."""

from __future__ import annotations

import math
import numbers
from itertools import compress

import mujoco
import numpy as np

from impactlaw.errors import OptionError, RestitutionError, SceneError, instead_of
from impactlaw.laws import Coulomb, Fremond, Law, LinearMap, Routh
from impactlaw.laws.restitution.coefficients import ContactCoefficients
from impactlaw.laws.restitution.labels import canonical, check_labels
from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.contacts import contact_labels, geom_names
from impactlaw.scene.friction_rows import pair_friction
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.pairs import geom_pairs, one_contact
from impactlaw.stepping.plan import Plan

_LARGEST_FRICTION = 1e4  # at ten times that boxes slide a tenth farther, and at 1e8 freely
_RESOLVED = 1e-15  # rounding of gaps, relative to the size of the scene
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_NAMED = 5  # largest number of contacts that an error names
_OF_CONTACT = [
    int(getattr(mujoco.mjtSensor, f"mjSENS_{name}"))
    for name in (
        "TOUCH", "CONTACT", "TACTILE", "FORCE", "TORQUE", "JOINTLIMITPOS", "JOINTLIMITVEL", "JOINTLIMITFRC",
        "TENDONLIMITPOS", "TENDONLIMITVEL", "TENDONLIMITFRC", "PLUGIN",
    )
]  # fmt: skip
"""Kinds of sensors that read contacts and constraint rows of a step; plugins, such as touch grids, may do so."""

FRICTION = ("coulomb", "convex", "ignore")
"""Options of friction: exact cones, their convex relaxation, no friction."""


def check_model(model: object) -> None:
    """Refuse a model that is not a compiled scene.

    Raises:
        SceneError: the model is something else, such as the path of a file.
    """
    if not isinstance(model, mujoco.MjModel):
        raise SceneError(
            f"a model is a mujoco.MjModel, got {model!r:.100}{instead_of(model)}; impactlaw.models.load and "
            "mujoco.MjModel.from_xml_path make one of a file"
        )


def check_resolved(model: mujoco.MjModel, gap_tolerance: float) -> None:
    """Refuse a gap tolerance that positions cannot resolve: contacts would open and close by rounding.

    Raises:
        SceneError: the tolerance is below the rounding of the largest size or distance in the scene.
    """
    extent = max(np.abs(model.body_pos).max(), model.geom_rbound.max(initial=0.0))
    if gap_tolerance < _RESOLVED * extent:
        raise SceneError(
            f"a gap tolerance of {gap_tolerance:g} m is below the rounding of positions in a scene of {extent:.2g} m; "
            f"pass gap_tolerance={1e-9 * extent:.0e}, or at least {_rounded_up(_RESOLVED * extent)}, or use "
            'scheme="time-stepping"'
        )


def _rounded_up(value: float) -> str:
    """Return a positive number rounded up to one digit, as text."""
    text = f"{value:.0e}"
    return text if float(text) >= value else f"{float(text) + 10.0 ** math.floor(math.log10(value)):.0e}"


def check_rigid(model: mujoco.MjModel) -> None:
    """Refuse scenes that event-driven steps would simulate wrongly.

    Raises:
        SceneError: the scene has flexes, adhesion, delays, or geoms whose shape is a signed distance function.
    """
    check_time_stepping(model)
    meeting = geom_pairs(model).geoms
    shaped = meeting[model.geom_type[meeting] == int(mujoco.mjtGeom.mjGEOM_SDF)]
    if len(shaped):
        raise SceneError(
            f"MuJoCo samples the contacts of signed distance functions ({geom_names(model)[shaped[0]]} is one): "
            'no gap can be located; use scheme="time-stepping", or contact_model="soft"'
        )
    adhesion = int(mujoco.mjtTrn.mjTRN_BODY)
    if model.flg_adhesion or (model.actuator_trntype == adhesion).any():
        raise SceneError(
            "contacts that are located do not pull, but the scene has adhesion; "
            'use scheme="time-stepping" or contact_model="soft"'
        )


def check_time_stepping(model: mujoco.MjModel) -> None:
    """Refuse scenes that no rigid scheme covers.

    Raises:
        SceneError: the scene has flexes or delays.
    """
    if model.nflex:
        raise SceneError('rigid stepping is between geoms only, but the scene has a flex; use contact_model="soft"')
    if model.nhistory:
        raise SceneError(
            "MuJoCo's buffers of delayed actuators and sensors take one sample a step of MuJoCo's own; "
            'use contact_model="soft", or leave out delay and nsample'
        )


def check_scene_friction(model: mujoco.MjModel, plan: Plan) -> None:
    """Refuse friction of rigid contacts that rigid steps do not use or cannot resolve.

    Rows of friction are scaled by the coefficients of their cones. If these are too large, gaps are lost in the
    rounding of friction, and bodies that should stick slide or sink in.

    Raises:
        SceneError: MuJoCo's override of contacts is on, or a coefficient is too large or not finite.
    """
    check_override(model, plan)
    for name in ("geom_friction", "pair_friction"):
        if not np.isfinite(getattr(model, name)).all():
            raise SceneError(f"model.{name} has entries that are not finite")
    if plan.contact_model != "rigid" or not plan.friction:
        return
    geoms = plan.pairs.geoms
    dim, mu = pair_friction(model, geoms)
    mu = np.where(np.arange(5) < dim[:, None] - 1, mu, 0.0).max(axis=1, initial=0.0)
    most = int(mu.argmax())
    if mu[most] > _LARGEST_FRICTION:
        one, other = (geom_names(model)[geom] for geom in geoms[most])
        raise SceneError(
            f"rigid steps resolve coefficients of friction up to {_LARGEST_FRICTION:g}, got {mu[most]:g} of "
            f"{one}/{other}; 100 already keeps nearly everything from sliding"
        )


def check_override(model: mujoco.MjModel, plan: Plan) -> None:
    """Refuse to step rigid contacts whose friction is set by MuJoCo's override.

    Rigid steps use the override themselves, to detect contacts, and read the friction of geoms and pairs.
    """
    if plan.contact_model == "rigid" and plan.friction:
        refuse_override(model)


def refuse_override(model: mujoco.MjModel) -> None:
    """Refuse MuJoCo's override of contacts.

    Steps check this, too, because the flag may be set after the stepper was made.
    """
    if model.opt.enableflags & OVERRIDE:
        raise SceneError(
            'rigid steps do not use the friction that <flag override="enable"/> gives all contacts (o_friction); leave '
            "the flag out and set the friction of geoms and pairs (model.geom_friction, model.pair_friction), or use "
            'contact_model="soft". (Threads that step one model at once see each other\'s flag: copy.copy it for each)'
        )


def unread_sensors(model: mujoco.MjModel, plan: Plan) -> tuple[str, ...]:
    """Return the names of sensors that event-driven steps leave without the forces of contacts and limits."""
    if not (plan.detection or plan.limits):
        return ()
    found = np.flatnonzero(np.isin(model.sensor_type, _OF_CONTACT)).tolist()
    return tuple(model.sensor(i).name or f"sensor{i}" for i in found)


def flexes_touch(model: mujoco.MjModel) -> bool:
    """Return whether flexes of the scene can touch its geoms, other flexes or themselves."""
    if model.opt.disableflags & _NO_CONTACT:
        return False
    kinds = np.concatenate((model.geom_contype, model.flex_contype))
    wanted = np.concatenate((model.geom_conaffinity, model.flex_conaffinity))
    meets = ((model.flex_contype[:, None] & wanted) | (kinds & model.flex_conaffinity[:, None])) != 0
    alone = (model.flex_rigid != 0) | (model.flex_selfcollide == 0)
    meets[np.flatnonzero(alone), model.ngeom + np.flatnonzero(alone)] = False
    return bool(meets.any())


def check_law(model: mujoco.MjModel, law: Law, chosen: Chosen | None = None) -> None:
    """Refuse a law that can resolve no collision of the scene.

    Raises:
        UnknownNameError: the law is keyed by contacts that the scene cannot have. The message names the nearest ones.
        RestitutionError: the law has more coefficients than the scene can have contacts, or no coefficients at all, or
            no coefficient for some contacts and no default; or its linear map is for another number of velocities.
    """
    inner = law.normal_law
    used, size = inner.contact_labels, inner.contact_count
    if isinstance(inner, LinearMap) and len(inner.h) != model.nv:  # pyright: ignore[reportArgumentType]
        raise RestitutionError(
            f"the linear map is for {len(inner.h)} degrees of freedom, but the scene has {model.nv}"  # pyright: ignore[reportArgumentType]
        )
    if used:
        known = contact_labels(geom_pairs(model).geoms, geom_names(model)) + Limits(model).names
        check_labels(used, known, patterns=not isinstance(inner, Fremond))
        _check_all_named(inner, known if chosen is None else tuple(compress(known, chosen.mask(known))))
    if size == 0:
        raise RestitutionError(f"{type(inner).__name__} has coefficients for no contact; key them by contact label")
    if size is not None and size > (most := most_contacts(model)):
        raise RestitutionError(
            f"{type(inner).__name__} has coefficients for {size} contacts, but the scene never has more than {most:g} "
            "at once; key them by contact label, or give one for all"
        )


def _check_all_named(law: Law, known: tuple[str, ...]) -> None:
    """Refuse a law that lacks a contact of the scene, whose first collision would end the run."""
    if not isinstance(law, ContactCoefficients) or (law.default is not None and not law.patterns):
        return
    missing = sorted(canonical(label) for label in set(known) if law.named(label) is None)
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise RestitutionError(
            f"{type(law).__name__} has no restitution for contacts that the scene can have: "
            f"{', '.join(missing[:_NAMED])}{more}; name them, or give a default "
            '(in a scene: <numeric name="restitution" data="..."/>)'
        )


def most_contacts(model: mujoco.MjModel) -> float:
    """Return the largest number of contacts at once, limits included; infinite if it is not known."""
    geoms = geom_pairs(model).geoms
    if model.nflex or not one_contact(model, geoms).all():
        return math.inf
    return len(geoms) + len(Limits(model).names)


def check_friction(law: Law, friction: str | None, solver: str | None = None) -> None:
    """Refuse a law with friction if an option contradicts its friction, or its own way to find impulses."""
    if isinstance(law, Routh) and solver not in (None, "auto"):
        raise RestitutionError(f"Routh's law finds its impulses itself: solver={solver!r} contradicts it; leave it out")
    if isinstance(law, Routh) and friction == "convex":
        raise RestitutionError("Routh's law has exact Coulomb friction: friction='convex' contradicts it; leave it out")
    if not isinstance(law, Coulomb) or friction is None:
        return
    if friction == "ignore":
        raise RestitutionError(
            f'friction="ignore" leaves friction out: {law!r} would lose its friction; pass the law inside of it, '
            f"{law.law!r}"
        )
    if friction != {"exact": "coulomb", "convex": "convex"}[law.cone]:
        raise RestitutionError(f"friction={friction!r} contradicts the law, whose cone is {law.cone!r}; leave it out")


def _is_number(value: object) -> bool:
    """Return whether a value is a real number; True and False are not."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def check_rest_speed(speed: float | None) -> None:
    """Raise `OptionError` if a speed is not a number (True and False are not), or is NaN, negative or infinite."""
    if speed is not None and not (_is_number(speed) and 0.0 <= float(speed) < math.inf):
        raise OptionError(f"rest_speed must be a speed of 0 m/s or more, got {speed!r}")


def check_gap_tolerance(length: float | None) -> None:
    """Raise `OptionError` if a length is not a number (True and False are not), or is NaN, infinite or not positive."""
    if length is not None and not (_is_number(length) and 0.0 < float(length) < math.inf):
        raise OptionError(f"gap_tolerance must be a positive length in m, got {length!r}")


def check_count(name: str, value: int | None) -> None:
    """Refuse a value that is not a count.

    Raises:
        OptionError: the value is not a whole number, or is less than 1.
    """
    if isinstance(value, bool) or not (isinstance(value, numbers.Integral) and value >= 1):
        raise OptionError(f"{name} must be a whole number, 1 or more, got {value!r}")
