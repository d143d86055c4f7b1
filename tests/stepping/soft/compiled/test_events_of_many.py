"""Events of compiled soft steps in which dozens of bodies jam: compiled code tells the impulses, without a search."""

import numpy as np
import pytest
from stepping.time_stepping.test_events_by_themselves import silo

from impactlaw import Moreau, Stepper
from impactlaw.solvers.friction import solve
from impactlaw.stepping.soft.scheme import SoftStepping


def test_impulses_of_balls_that_jam_meet_the_law_without_a_search(monkeypatch):
    """A search for them takes over 1 000 steps, some 8 s, and can end at impulses that miss the law by a hundredth."""
    model, data = silo()
    stepper, told, in_python = Stepper(model, Moreau(0.5), contact_model="soft"), 0, []
    stepper.step(data, 150)
    take = SoftStepping.step
    monkeypatch.setattr(SoftStepping, "step", lambda *arguments: in_python.append(1) or take(*arguments))
    for _ in range(20):
        in_python.clear()
        stepper.step(data)
        if in_python:  # compiled code has not found an outcome
            continue
        with monkeypatch.context() as meanwhile:
            meanwhile.setattr(solve, "compiled_answer", lambda *_, **__: pytest.fail("it is searched for"))
            meanwhile.setattr(SoftStepping, "step", lambda *_: pytest.fail("it is in Python"))
            impacts, sums = [event.impact for event in stepper.events], stepper.sums
        assert len(impacts) == sums.collisions
        assert max((impact.residual for impact in impacts), default=0.0) < 1e-9
        np.testing.assert_allclose(sum(impact.energy_change for impact in impacts), sums.energy_change, rtol=1e-9)
        np.testing.assert_allclose(sum(impact.surface_work for impact in impacts), sums.surface_work, atol=1e-9)
        told += len(impacts)
    assert told > 9
