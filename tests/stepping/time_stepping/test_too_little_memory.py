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


@pytest.mark.parametrize("memory", ["60K", "80K", "100K"])
def test_an_error_of_mujoco_in_compiled_code_is_an_exception_and_loses_nothing(memory):
    """With these sizes distances of bodies or rows of contacts at the end of a step do not fit."""
    model = scene(memory)
    one, other = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.3), scheme="time-stepping")
    one.qvel[:] = 8.0 * np.random.default_rng(0).normal(size=model.nv)
    before = np.empty(0)
    with pytest.raises(mujoco.FatalError, match="out of memory"):
        for _ in range(60):
            before = np.concatenate([one.qpos, one.qvel, [one.time]])
            stepper.step(one)
    assert np.array_equal(np.concatenate([one.qpos, one.qvel, [one.time]]), before)
    assert one.pstack == one.pbase == 0  # nothing of MuJoCo's memory remains in use
    one.qvel[:], one.qpos[:] = 0.0, model.qpos0
    one.qpos[2::7] += 3.0 * np.arange(8)  # nothing touches for a while
    other.qpos[:], other.time = one.qpos, one.time
    fresh = Stepper(model, Moreau(0.3), scheme="time-stepping")
    for _ in range(10):
        stepper.step(one)
        fresh.step(other)
    assert np.array_equal(one.qpos, other.qpos)


def test_tendons_keep_their_ranges_where_margins_are_reduced_for_lack_of_room():
    """Rows of contacts do not fit: margins become smaller, as does what lies beside them in memory if it is scaled."""
    boxes = (
        f'<body pos="{0.25 * (i % 6)} {0.25 * (i // 6)} .12"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
        for i in range(12)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><size memory="54K"/><option timestep=".01" gravity="0 0 0"/><worldbody>
        <geom type="plane" size="3 3 1"/>{"".join(boxes)}<body pos="0 3 1"><joint name="slide" type="slide"/>
        <geom size=".05" contype="0" conaffinity="0"/></body></worldbody><tendon>
        <fixed limited="true" range="-1 1"><joint joint="slide" coef="1"/></fixed></tendon></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[-1], data.qvel[-1] = 0.8, 0.1
    data.qvel[2:-1:6] = -1.0
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(3):
        stepper.step(data)
    assert data.warning[mujoco.mjtWarning.mjWARN_CNSTRFULL].number > 0
    np.testing.assert_allclose((data.qpos[-1], data.qvel[-1]), (0.803, 0.1), rtol=1e-12)
