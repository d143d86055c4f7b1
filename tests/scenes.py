"""Scenes of a few lines, and steps of them, for the tests of stepping."""

import mujoco
import numpy as np


def compiled(world, rest="", *, option="", geom=""):
    """Model and data; ``world`` stands in worldbody, ``rest`` beside it, ``geom`` are defaults of all geoms."""
    xml = f"<mujoco><option {option}/><default><geom {geom}/></default><worldbody>{world}</worldbody>{rest}</mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def run(stepper, data, steps):
    """The collisions of as many steps."""
    events = []
    for _ in range(steps):
        stepper.step(data)
        events += stepper.events
    return events


def assert_steps_of_mujoco(stepper, data, reference, steps):
    """Bit for bit those of ``mj_step``, and without a collision."""
    for _ in range(steps):
        stepper.step(data)
        mujoco.mj_step(stepper.model, reference)
        assert stepper.events == ()
        assert np.array_equal(data.qpos, reference.qpos)
        assert np.array_equal(data.qvel, reference.qvel)


def energy(model, data):
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy.sum())


def mass_matrix(model, data):
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M
