"""A four-legged robot stands, lands and is held under time stepping, with feet of every condim."""

import numpy as np
import pytest
from scenes import energy
from stepping.quadrupeds import STANCE, gaps, quadruped
from stepping.time_stepping.stepped import stepping

from impactlaw import MaximalDissipation, Moreau, Newton, Poisson, Stepper


def run_to(stepper, data, time):
    while data.time < time - 1e-9:
        stepper.step(data)


@pytest.mark.parametrize("condim", [3, 4, 6])
@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(0.5), Poisson(0.5)], ids=["0", "moreau", "poisson"])
def test_it_stands_for_five_seconds_and_does_not_drift(condim, law):
    model, data, feet = quadruped(condim)
    data.qpos[2] += 0.05
    stepper = stepping(model, law)
    run_to(stepper, data, 2.0)
    start = data.qpos.copy()
    run_to(stepper, data, 5.0)
    assert 0.2 < data.qpos[2] < 0.4
    assert data.qpos[:3] == pytest.approx(start[:3], abs=1e-4)
    assert data.qpos[3:7] == pytest.approx(start[3:7], abs=5e-4)
    assert data.qpos[7:] == pytest.approx(start[7:], abs=1e-3)
    assert ((gaps(model, data, feet) >= -1e-8) & (gaps(model, data, feet) <= 1e-6)).all()
    assert stepper.short_steps <= 0.01 * 5.0 / model.opt.timestep


@pytest.mark.parametrize("condim", [3, 6])
def test_it_stands_by_a_controller_of_ones_own(condim):
    """A PD controller through qfrc_applied, and therefore explicit."""
    model, data, feet = quadruped(condim, servo=False, integrator="Euler", timestep=2e-3, armature=0.02)
    stepper = stepping(model, Moreau(0.0))
    start = None
    for i in range(1500):
        data.qfrc_applied[6:] = 120 * (STANCE - data.qpos[7:]) - 4 * data.qvel[6:]
        stepper.step(data)
        if i == 1000:
            start = data.qpos.copy()
    assert data.qpos[:3] == pytest.approx(start[:3], abs=1e-4)
    assert data.qpos[3:] == pytest.approx(start[3:], abs=1e-3)
    assert ((gaps(model, data, feet) >= -1e-8) & (gaps(model, data, feet) <= 1e-6)).all()


@pytest.mark.parametrize("condim", [3, 6])
def test_feet_never_sink_and_the_law_is_met_while_it_is_moved(condim):
    model, data, feet = quadruped(condim, timestep=2e-3)
    stepper, rng = stepping(model, Newton(0.3)), np.random.default_rng(1)
    worst, deepest = 0.0, 0.0
    for i in range(500):
        if i % 20 == 0:
            data.ctrl[:] = STANCE + rng.uniform(-0.3, 0.3, 12)
        stepper.step(data)
        worst = max(worst, stepper.shortfall)
        if i > 100:
            deepest = min(deepest, gaps(model, data, feet).min())
    assert deepest > -1e-5
    assert worst < 1e-2
    assert stepper.short_steps <= 5


def test_it_falls_without_a_controller_and_loses_energy_only():
    model, data, _ = quadruped(servo=False, timestep=1e-3)
    stepper = stepping(model, Moreau(0.3))
    start = energy(model, data)
    last = start
    for _ in range(400):
        stepper.step(data)
        now = energy(model, data)
        assert now <= last + 1e-4 * start
        last = now
    assert last < start


def test_it_slides_on_ice_and_is_braked_on_felt():
    """Pushed at 0.5 m/s: without friction it keeps moving, with friction it stops."""
    speeds = []
    for friction in ("ignore", "coulomb"):
        model, data, _ = quadruped(3)
        stepper = stepping(model, Moreau(0.0), friction=friction)
        run_to(stepper, data, 0.5)
        data.qvel[0] += 0.5
        run_to(stepper, data, 4.0)
        speeds.append(abs(data.qvel[0]))
    assert speeds[0] > 0.4
    assert speeds[1] < 1e-3


@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(0.5)], ids=["0", "moreau"])
def test_it_stands_on_feet_of_condim_6_under_event_driven_steps(law):
    model, data, feet = quadruped(6)
    data.qpos[2] += 0.05
    stepper = Stepper(model, law)
    run_to(stepper, data, 1.5)
    start = data.qpos.copy()
    run_to(stepper, data, 3.0)
    assert data.qpos[:3] == pytest.approx(start[:3], abs=5e-3)
    assert np.abs(gaps(model, data, feet)).max() < 1e-8
