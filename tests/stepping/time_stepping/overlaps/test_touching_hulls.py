"""Hulls at rest that touch stay where they are while other bodies are pushed out of each other.

MuJoCo finds them centimeters deep in each other if it looks for contacts only within some 1e-7 m.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw import Moreau, Stepper

_PAIRS = 20
_CUBE = "-1 -1 -1  1 -1 -1  1 1 -1  1 1 1  1 -1 1  -1 1 -1  -1 1 1  -1 -1 1"
_SHAPES = "box", "cylinder", "ellipsoid", "box", "cylinder", "ellipsoid"


def _scene() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return pairs of cubes whose faces touch, without weight, and bodies that tumble on a floor."""
    cube = '<body gravcomp="1"><freejoint/><geom type="mesh" mesh="cube"/></body>'
    tumbling = "".join(
        f'<body pos="{0.3 * k} 0 .12" euler="{10 + 37 * k} {25 + 11 * k} 3"><freejoint/>'
        f'<geom type="{shape}" size=".05 .06 .07"/></body>'
        for k, shape in enumerate(_SHAPES)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001"/><default><geom condim="1"/></default>
        <asset><mesh name="cube" scale=".025 .025 .025" vertex="{_CUBE}"/></asset>
        <worldbody><geom type="plane" size="5 5 1"/>{2 * _PAIRS * cube}{tumbling}</worldbody></mujoco>"""
    )
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    for k, pose in enumerate(data.qpos[: 14 * _PAIRS].reshape(_PAIRS, 2, 7)):
        quat, turn = np.array([1.0, *random.normal(0.0, 0.1, 3)]), np.zeros(9)
        pose[:, 3:] = quat / np.linalg.norm(quat)
        mujoco.mju_quat2Mat(turn, pose[0, 3:])
        pose[:, :3] = 0.2 * k, 1.0, 1.0
        pose[1, :3] += turn.reshape(3, 3) @ [*random.normal(0.0, 1e-6, 2), 0.05 + random.uniform(-1e-8, 1e-8)]
    return model, data


def test_touching_cubes_stay_while_other_bodies_tumble():
    model, data = _scene()
    stepper, start = Stepper(model, Moreau(0.0), scheme="time-stepping"), data.qpos.copy()
    for _ in range(200):
        stepper.step(data)
    assert np.abs(data.qpos - start)[: 14 * _PAIRS].max() < 1e-6
    assert np.abs(data.qpos - start)[14 * _PAIRS :].max() > 0.01
