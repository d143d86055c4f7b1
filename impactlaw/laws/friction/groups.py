"""Groups of contacts that influence each other: restitution that creates energy is scaled in its own group only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from impactlaw.laws.base import Law, RestitutionLaw
from impactlaw.laws.compliant import Compliant
from impactlaw.laws.restitution.coefficients import ContactCoefficients
from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_gradients
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.sparsity import components

_FEW = 8  # contacts up to which splitting by degrees of freedom does not pay


def apart(collision: Collision, law: Law) -> list[tuple[np.ndarray, Collision]]:
    """Split a collision where contacts share no degrees of freedom; return contacts, ascending, and collision of each.

    Each part has its own degrees of freedom only, so that the cost grows with the number of bodies and not with its
    cube. The list is empty if all contacts are connected, if they are few, or if the normal law couples contacts.
    """
    h, nv = collision.jacobian.shape
    if h <= _FEW or ties_of(law, collision) is not None:
        return []
    touched, friction, bilateral = collision.jacobian != 0.0, collision.friction, collision.bilateral_jacobian
    assert friction is not None
    np.logical_or.at(touched, friction.contact, friction.jacobian != 0.0)
    ties = touched if bilateral is None else np.vstack([touched, bilateral != 0.0])
    rows = scipy.sparse.csr_array(ties)
    graph = scipy.sparse.block_array([[scipy.sparse.csr_array(collision.mass_matrix != 0.0), rows.T], [rows, None]])
    member = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    owner = member[nv : nv + h]
    if not touched.any(axis=1).all() or (owner == owner[0]).all():
        return []
    parts = []
    for own in np.unique(owner):
        contacts, dofs, equal = np.flatnonzero(owner == own), member[:nv] == own, member[nv + h :] == own
        part, metric = collision.part(contacts), KineticMetric(collision.mass_matrix[np.ix_(dofs, dofs)])
        assert part.friction is not None
        alone = replace(
            part,
            mass_matrix=metric.mass_matrix,
            metric=metric,
            jacobian=part.jacobian[:, dofs],
            pre_velocity=part.pre_velocity[dofs],
            bilateral_jacobian=None if bilateral is None or not equal.any() else bilateral[equal][:, dofs],
            friction=replace(part.friction, jacobian=part.friction.jacobian[:, dofs]),
        )
        parts.append((contacts, alone))
    return parts


def groups_of(problem: ConeProblem, ties: np.ndarray | None) -> list[np.ndarray]:
    """Return the groups of contacts coupled by impulses or by `ties_of` a law, each as ascending indices."""
    h, m = problem.shape
    coupled = np.count_nonzero((np.abs(problem.delassus) > INFLUENCE).reshape(h, m, h, m), axis=(1, 3)) > 0
    return components(coupled if ties is None else coupled | ties)


def ties_of(law: Law, collision: Collision) -> np.ndarray | None:
    """Return which targets depend on the velocity of which contacts, bool (h, h); all True if that is not known.

    None means that targets depend at most on contacts that influence each other through impulses anyway.
    """
    law = law.normal_law
    if law.common_coefficient is not None or isinstance(law, ContactCoefficients | Compliant):
        return None
    if isinstance(law, RestitutionLaw):
        E = law.restitution_matrix(collision)
        return (E if isinstance(E, np.ndarray) else E.toarray()) != 0.0
    return np.ones((len(collision.labels),) * 2, dtype=bool)


def joined(collision: Collision, parts: Sequence[tuple[np.ndarray, FrictionImpact]]) -> FrictionImpact:
    """Return the impact put together from those of groups of contacts that do not influence each other.

    Each part is the contacts of a group, ascending, and an impact: that of these contacts alone, see `Collision.part`,
    or that of the whole collision.
    """
    friction, h = collision.friction, len(collision.labels)
    assert friction is not None
    normal, target, along, sliding = np.zeros(h), np.zeros(h), np.zeros(len(friction)), np.zeros(len(friction))
    aimed = True
    for contacts, impact in parts:
        rows, whole = np.flatnonzero(np.isin(friction.contact, contacts)), len(impact.impulse) == h
        own, rubs = (contacts, rows) if whole else (slice(None), slice(None))
        normal[contacts], along[rows] = impact.impulse[own], impact.friction_impulse[rubs]
        if impact.target_contact_velocity is None or impact.target_sliding_velocity is None:
            aimed = False
            continue
        target[contacts] = impact.target_contact_velocity[own]
        sliding[rows] = impact.target_sliding_velocity[rubs]
    impulse = np.concatenate([normal, along / friction.coefficient])[collision.cone_rows.order]
    jump, targets = impulse @ cone_gradients(collision), (target, sliding) if aimed else None
    more = {"restitution_scale": min(impact.restitution_scale for _, impact in parts), "exact": parts[0][1].exact}
    return FrictionImpact.of_cones(collision, impulse, jump, targets, **more)
