"""Time steps in scenes for whose contacts MuJoCo has too little memory; without care its error ends the process."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

SHAPES = "box", "cylinder", "ellipsoid", "capsule"
BODY = '<body pos="{} {} {}"><freejoint/><geom type="{}" size=".1 .05 .04"/></body>'


def scene(memory: str) -> mujoco.MjModel:
    bodies = (BODY.format(0.15 * (i % 4), 0.15 * (i // 4), 0.1 + 0.13 * (i % 3), SHAPES[i % 4]) for i in range(8))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><size memory="{memory}"/><option timestep=".02"/><worldbody><geom type="plane" size="3 3 1"/>'
        f"{''.join(bodies)}</worldbody></mujoco>"
    )


@pytest.mark.parametrize("compiled", ["never", "auto"])
@pytest.mark.parametrize("memory", ["60K", "80K", "100K"])
def test_an_error_of_mujoco_in_compiled_code_is_an_exception_and_loses_nothing(memory, compiled):
    """With these sizes distances of bodies or rows of contacts at the end of a step do not fit."""
    model = scene(memory)
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.3), scheme="time-stepping", compiled=compiled)
    one.qvel[:] = 8.0 * np.random.default_rng(0).normal(size=model.nv)
    before = np.empty(0)
    with pytest.raises(mujoco.FatalError, match="out of memory"):
        for _ in range(60):
            before = np.concatenate([one.qpos, one.qvel, [one.time]])
            stepper.step(one)
    assert np.array_equal(np.concatenate([one.qpos, one.qvel, [one.time]]), before)
    one.qvel[:], one.qpos[:] = 0.0, model.qpos0
    one.qpos[2::7] += 3.0 * np.arange(8)  # nothing touches for a while
    other.qpos[:], other.time = one.qpos, one.time
    fresh = Stepper(model, Moreau(0.3), scheme="time-stepping", compiled=compiled)
    for _ in range(10):
        stepper.step(one)
        fresh.step(other)
    assert np.array_equal(one.qpos, other.qpos)
