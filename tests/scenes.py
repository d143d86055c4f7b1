"""Scenes of a few lines, steps of them, and what touches in a scene."""

from itertools import pairwise

import mujoco
import numpy as np

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")


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


def chain_labels(n: int, first: int = 1) -> list[str]:
    return [f"ball{i}/ball{i + 1}" for i in range(first, first + n - 1)]


RACK_ROWS = [list(range(k * (k + 1) // 2 + 1, (k + 1) * (k + 2) // 2 + 1)) for k in range(5)]
RACK_PAIRS = {(a, b) for row in RACK_ROWS for a, b in pairwise(row)} | {
    (a, below[j + side]) for row, below in pairwise(RACK_ROWS) for j, a in enumerate(row) for side in (0, 1)
}
TOUCHING = {
    "ball_chain": chain_labels(3),
    "ball_stack": chain_labels(10),
    "billiard_rack": [f"ball{a}/ball{b}" for a, b in sorted(RACK_PAIRS)],
    "bouncing_ball": [],
    "box_drop": [],
    "falling_rod": [],
    "juggler": [],
    "newtons_cradle": chain_labels(5),
    "rocking_block": ["floor/right"],
    "rocking_platform": ["left/platform", "right/platform"],
    "wedge": ["floor/ball", "ramp/ball"],
}


def detect(model, data, within=1e-8):
    """Frames, inertia and contacts up to ``within``, whatever margins the geoms have."""
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    model.opt.o_margin = within
    mujoco.mj_fwdPosition(model, data)
    return list(data.contact)


def label(model, contact) -> str:
    return f"{model.geom(contact.geom1).name}/{model.geom(contact.geom2).name}"


JAM_QPOS = (0.4457981582724121, -0.558477804158606, 3.3857348652983066, 0.08360307738456153, -0.3349162836963793,
            -0.08379352238281934, -0.14301812201735048, 0.31057723813866245, 0.434012231578805)  # fmt: skip
JAM_QVEL = (0.527816313977751, -1.3711659752970318, 2.7198667235839746, -1.902185217506624, -4.518610387869375,
            10.94225096252503, -6.400186006408575, -7.601018849032579, -5.168769384835644)  # fmt: skip
"""A HalfCheetah on its back whose torso and thigh jam on the floor: compiled code leaves that to Python."""
