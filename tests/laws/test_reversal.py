"""The reversal law: chains pass their velocities on, in whatever order bodies and contacts are numbered."""

import mujoco
import numpy as np
import pytest
import scipy.sparse
from problems import launched

from impactlaw import Collision, Fremond, Stepper

EXACT = {"rtol": 0, "atol": 1e-12}
ORDERS = [np.random.default_rng(seed).permutation(7) for seed in range(5)]


def shuffled(collision, order, form=np.array):
    """Return the collision with its contacts in another order."""
    return Collision(form(collision.mass_matrix), form(collision.jacobian[order]), collision.pre_velocity)


@pytest.mark.parametrize("form", [np.array, scipy.sparse.csr_array])
@pytest.mark.parametrize("order", ORDERS)
def test_contacts_of_a_chain_in_any_order(order, form):
    c = launched(8, 3)
    impact = Fremond.reversal().resolve(shuffled(c, order, form))
    np.testing.assert_allclose(impact.post_velocity, c.pre_velocity[::-1], **EXACT)


@pytest.mark.parametrize("order", ORDERS)
def test_two_chains_whose_contacts_are_mixed(order):
    """Chains of four and five balls."""
    jacobian = np.diff(np.eye(9), axis=0)[[0, 1, 2, 4, 5, 6, 7]]
    velocity = np.array([1.0, 0, 0, 0, 2, 2, 0, 0, 0])
    impact = Fremond.reversal().resolve(Collision(np.eye(9), jacobian[order], velocity))
    np.testing.assert_allclose(impact.post_velocity, [0, 0, 0, 1, 0, 0, 0, 2, 2], **EXACT)


def test_contacts_that_are_no_chain_are_reversed_as_they_come():
    """Three balls hit a fourth one, so that each contact influences all others."""
    jacobian = np.hstack([np.ones((3, 1)), -np.eye(3)])
    for order in ([0, 1, 2], [1, 0, 2], [2, 0, 1]):
        c = Collision(np.eye(4), jacobian[order], [-1.0, 0.2, 0.3, 0.4])
        np.testing.assert_allclose(Fremond.reversal(0.5).restitution_matrix(c), 0.5 * np.eye(3)[::-1])


def cradle(order):
    """Return five equal touching balls in a row, which the MJCF lists in this order."""
    balls = "".join(
        f'<body pos="{0.1999999 * i} 0 0"><joint name="x{i}" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/>'
        "</body>"
        for i in order
    )
    option = '<option gravity="0 0 0" timestep=".002"/><default><geom friction="0"/></default>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{balls}</worldbody></mujoco>")


@pytest.mark.parametrize(
    "way",
    [
        {"contact_model": "soft"},
        {"overlap": "push-out"},
        {"scheme": "time-stepping"},
        {"scheme": "time-stepping", "compiled": "never"},
    ],
    ids=["soft", "event-driven", "time-stepping", "time-stepping, asked in Python"],
)
@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (2, 0, 4, 1, 3), (4, 1, 0, 3, 2)])
def test_bodies_of_a_cradle_in_any_order(way, order):
    model = cradle(order)
    data = mujoco.MjData(model)
    for i, speed in enumerate([1.0, 1.0, 0.0, 0.0, 0.0]):
        data.joint(f"x{i}").qvel = speed
    stepper = Stepper(model, Fremond.reversal(), **way)
    stepper.step(data)
    (event,) = stepper.events
    order = [model.joint(f"x{i}").dofadr[0] for i in range(5)]
    np.testing.assert_allclose(event.impact.post_velocity[order], [0, 0, 0, 1, 1], atol=1e-9)
    if way.get("contact_model") != "soft":  # soft steps go on after the event
        np.testing.assert_allclose(data.qvel[order], [0, 0, 0, 1, 1], atol=1e-9)
