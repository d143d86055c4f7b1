"""Reading contacts and collisions out of a model and its state: what is refused rather than misread."""

import copy

import mujoco
import numpy as np
import pytest

from impactlaw import Collision, read_contacts
from impactlaw.errors import DivergenceError, InvalidCollisionError, OptionError, SceneError
from impactlaw.models import load


def slider():
    """A scene of one degree of freedom, whose single number fits into any array."""
    body = '<body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("read", [read_contacts, Collision.from_mujoco])
def test_data_of_another_model_is_refused(read):
    model, data = load("box_drop")
    for other in (slider()[1], load("ball_chain")[1]):
        with pytest.raises(SceneError, match="another model"):
            read(model, other)
    with pytest.raises(SceneError, match="got MjData and MjModel"):
        read(data, model)
    read(copy.copy(model), data)
    read(model, load("box_drop")[1])


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_position_that_is_not_finite_is_refused(number):
    """MuJoCo finds no contacts of such a body, and its mass matrix can be finite."""
    model, data = load("box_drop")
    data.qpos[0] = number
    with pytest.raises(InvalidCollisionError, match="not finite"):
        Collision.from_mujoco(model, data)
    with pytest.raises(DivergenceError, match="not finite"):
        read_contacts(model, data)
    model, data = load("juggler")
    data.mocap_pos[0, 2] = number
    with pytest.raises(InvalidCollisionError, match="mocap"):
        Collision.from_mujoco(model, data)


@pytest.mark.parametrize("within", [-1.0, np.nan, np.inf, None, "1"])
def test_a_largest_gap_that_is_none_is_refused(within):
    with pytest.raises(OptionError, match="within is a gap of 0 m or more"):
        read_contacts(*load("ball_chain"), within=within)
