"""Fields that are stored inside mjData, not behind a pointer, can be bound like others."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Stepper
from impactlaw.models import load


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_energy_of_all_worlds(contact_model):
    model, start = load("bouncing_ball")
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    batch = Batch(model, Moreau(0.5), 3, contact_model=contact_model)
    energy, qpos = batch.bind("energy"), batch.bind("qpos")
    qpos[:] = start.qpos
    qpos[1] += 0.5
    heights = qpos.copy()
    way = {"contact_model": "soft"} if contact_model == "soft" else {"scheme": "time-stepping"}
    batch.step(nstep=5)
    for world in range(3):
        data = mujoco.MjData(model)
        data.qpos[:] = heights[world]
        stepper = Stepper(model, Moreau(0.5), **way)
        stepper.step(data, 5)
        np.testing.assert_allclose(energy[world], data.energy, atol=1e-12)
    assert energy[1, 0] > energy[0, 0] + 1.0


@pytest.mark.parametrize("name", ["solver_niter", "solver_nnz", "solver_fwdinv"])
def test_what_the_solver_tells(name):
    model, start = load("box_drop")
    batch = Batch(model, Moreau(0.5), 2, contact_model="soft")
    bound = batch.bind(name)
    batch.bind("qpos")[:] = start.qpos
    batch.step(nstep=20)
    assert bound.shape == (2, *np.shape(getattr(start, name)))
    assert np.isfinite(bound).all()
