"""No collision creates energy, in every scene of the package and for a robot with friction and joint limits."""

import gymnasium
import mujoco
import numpy as np
import pytest
from wrapped import theirs

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper
from impactlaw.models import load, scene_names

pytestmark = [theirs, pytest.mark.usefixtures("quiet")]
LAWS = (MaximalDissipation(), Moreau(0.5), Moreau(1.0), Newton(0.8))


def start(name):
    if name in scene_names():
        return load(name)
    env = gymnasium.make(name).unwrapped
    env.reset(seed=0)
    return env.model, env.data


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize("name", [*scene_names(), "Hopper-v5"])
def test_no_collision_creates_energy(name, law):
    model, first = start(name)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = first.qpos, first.qvel
    stepper = Stepper(model, law, overlap="push-out", on_inadmissible="allow")
    rng, impacts = np.random.default_rng(0), []
    for step in range(600):
        if step % 5 == 0 and model.nu:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        stepper.step(data)
        impacts += [event.impact for event in stepper.events]
        if impacts and step >= 40:
            break
    assert impacts
    for impact in impacts:
        assert impact.violations.energetic <= 1e-9 * impact.violations.pre_speed
        assert impact.residual < 1e-9
