"""Events of compiled soft steps in which dozens of bodies jam: impulses follow from outcomes, without a search."""

import numpy as np
from stepping.time_stepping.test_events_by_themselves import silo

from impactlaw import Moreau, Stepper
from impactlaw.solvers.friction import solve


def test_impulses_of_balls_that_jam_are_found_in_few_steps_and_meet_the_law(monkeypatch):
    """A search for them takes over 1 000 steps, some 8 s, and can end at impulses that miss the law by a hundredth."""
    model, data = silo()
    stepper, taken, find = Stepper(model, Moreau(0.5), contact_model="soft"), [], solve.compiled_answer

    def counted(*args, **options):
        found = find(*args, **options)
        taken.append(found[1])
        return found

    monkeypatch.setattr(solve, "compiled_answer", counted)
    for _ in range(160):
        stepper.step(data)
    taken.clear()
    for _ in range(9):
        stepper.step(data)
        impacts, sums = [event.impact for event in stepper.events], stepper.sums
        assert len(impacts) == sums.collisions
        assert max((impact.residual for impact in impacts), default=0.0) < 1e-9
        np.testing.assert_allclose(sum(impact.energy_change for impact in impacts), sums.energy_change, rtol=1e-9)
        np.testing.assert_allclose(sum(impact.surface_work for impact in impacts), sums.surface_work, atol=1e-9)
    assert 0 < sum(taken) < 300
