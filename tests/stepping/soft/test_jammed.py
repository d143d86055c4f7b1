"""Bodies that jam, so that no impulses meet law and friction, do not end a run under soft steps."""

import gymnasium as gym
import mujoco
import pytest

from impactlaw import Moreau, Stepper

QPOS = (-8.756441491107173, -0.5294397993016361, 3.446350937151604, 0.4032184000507698, -0.3269331208193089,
        -0.008362221697740022, 0.27571687676287643, 0.36444716320914206, 0.09693485059105762)  # fmt: skip
QVEL = (0.25977730331245696, -1.549247649343238, 3.877177114182032, -4.074811278541012, -13.308072276621568,
        11.739245103330694, -11.763683576082812, 5.911472684886507, 0.16368325580040494)  # fmt: skip
"""A HalfCheetah under random actions, on its back: torso and thigh touch the floor."""


def jammed():
    model = gym.make("HalfCheetah-v5").unwrapped.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = QPOS, QVEL
    return model, data


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_mujoco_takes_such_a_step(compiled):
    model, data = jammed()
    bare = mujoco.MjData(model)
    bare.qpos[:], bare.qvel[:] = QPOS, QVEL
    stepper = Stepper(model, Moreau(0.0), contact_model="soft", compiled=compiled)
    assert stepper.short_steps == 0
    stepper.step(data)
    mujoco.mj_step(model, bare)
    assert stepper.short_steps == 1
    assert not stepper.events
    assert (data.qvel == bare.qvel).all()
    stepper.step(data)
    assert stepper.short_steps == 1
