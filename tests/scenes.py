"""Small scenes, steps of them, and their contacts."""

from itertools import pairwise

import mujoco
import numpy as np

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")
WAYS = {
    "time-stepping": {"scheme": "time-stepping"},
    "soft": {"contact_model": "soft"},
    "soft in Python": {"contact_model": "soft", "compiled": "never"},
    "event-driven": {},
}
"""Options of a stepper for each way to step, soft steps compiled and not."""


def compiled(world, rest="", *, option="", geom=""):
    """Return model and data; ``world`` is the worldbody, ``rest`` follows it, ``geom`` sets defaults of all geoms."""
    xml = f"<mujoco><option {option}/><default><geom {geom}/></default><worldbody>{world}</worldbody>{rest}</mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def run(stepper, data, steps):
    """Take steps, and return their collisions."""
    events = []
    for _ in range(steps):
        stepper.step(data)
        events += stepper.events
    return events


def assert_steps_of_mujoco(stepper, data, reference, steps):
    """Assert that steps equal ``mj_step``, bit for bit, and have no collision."""
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
    """Update frames and inertia, and find contacts up to ``within``, whatever margins the geoms have."""
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    model.opt.o_margin = within
    mujoco.mj_fwdPosition(model, data)
    return list(data.contact)


def label(model, contact) -> str:
    return f"{model.geom(contact.geom1).name}/{model.geom(contact.geom2).name}"


HELD = """<mujoco><worldbody><geom type="plane" size="9 9 1"/>
  <body name="arm" pos="0 0 .0999"><joint name="held" axis="0 1 0"/><geom size=".1" pos="{arm} 0 0" mass="1"/></body>
  <body pos="{arm} 0 .299"><joint type="slide"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
    <geom size=".1" mass="1"/></body></worldbody>
  <equality><joint joint1="held"/></equality>
  <actuator><motor joint="held" gear="0" ctrlrange="-1 1"/></actuator></mujoco>"""
"""An arm whose length lets a constraint hold it on the floor, m, and a ball on it.

The constraint leaves no free motion at the contact with the floor; compiled soft steps leave such collisions to
Python. If this contact closes fast, by `CLOSING` of an arm of 10 m, while the constraint holds, no impulses exist.
"""
FALLING, CLOSING = (0.0, 0.3, -1.0, 0.0), (0.1, 0.0, 0.0, 0.0)
