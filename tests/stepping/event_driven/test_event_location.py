"""The times at which gaps close: cubics through the observations of phases, and the number of phases needed."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.stepping.event_driven import smooth_phase
from impactlaw.stepping.event_driven.location.gap_functions import GapFunctions, Observation
from impactlaw.stepping.event_driven.location.search import locate
from impactlaw.stepping.event_driven.persistent_contact import frictional
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases


class Tried:
    """A phase after which contacts 0, 1, .. have gaps that are functions of its duration."""

    def __init__(self, duration, gaps, slopes):
        self.duration = duration
        self.observations = [
            Observation(i, gap(duration), slope(duration), slope(0.0))
            for i, (gap, slope) in enumerate(zip(gaps, slopes, strict=True))
        ]
        self.gap = min(observation.gap for observation in self.observations)


def located(gaps, slopes, duration, tolerance=1e-9, *, exact=True):
    """Return the phase up to the first gap that closes, and the durations of all phases tried."""
    gap_functions = GapFunctions(np.array([g(0.0) for g in gaps]), np.array([s(0.0) for s in slopes]), exact=exact)
    tried = []

    def advance_to_contact(time):
        tried.append(time)
        return Tried(time, gaps, slopes)

    end = advance_to_contact(duration)
    gap_functions.add(duration, end.observations)
    found = locate(
        advance_to_contact,
        end,
        gap_functions,
        target=1e-2 * tolerance,
        tolerance=tolerance,
        shortest=1e-12,
    )
    return found, tried


def test_first_gap_to_close_is_found_where_another_one_is_deeper_in_the_end():
    gaps = [lambda t: 0.1 - t, lambda t: 0.3 - 5 * t**2]
    found, tried = located(gaps, [lambda t: -1.0, lambda t: -10 * t], 0.5)
    assert found.duration == pytest.approx(0.1, abs=1e-11)
    assert len(tried) <= 3


def test_contact_that_opens_at_the_start_closes_later_than_that():
    found, tried = located([lambda t: t - 50 * t**2], [lambda t: 1 - 100 * t], 1.0)
    assert found.duration == pytest.approx(0.02, abs=1e-11)
    assert len(tried) <= 2


def test_gap_that_is_no_cubic_is_found_in_a_few_flows():
    gap, slope = lambda t: math.sin(20 * t) + 0.05 * t, lambda t: 20 * math.cos(20 * t) + 0.05
    found, tried = located([gap], [slope], 0.25)
    assert abs(found.gap) <= 1e-11
    assert found.duration == pytest.approx(math.pi / 20, rel=1e-2)
    assert len(tried) <= 5


def test_gap_that_jumps_is_found_by_bisection():
    found, _ = located([lambda t: 1.0 if t < 0.3 else -1.0], [lambda t: 0.0], 1.0)
    assert 0.3 <= found.duration <= 0.3 + 1e-11
    assert found.gap == -1.0


def test_gap_that_jumps_is_found_whatever_its_slopes_promise():
    found, tried = located([lambda t: 1.0 if t < 0.3 else -1e-6], [lambda t: -1e-3], 1.0)
    assert 0.3 <= found.duration <= 0.3 + 1e-11
    assert len(tried) <= 60


def test_gap_that_was_not_seen_at_the_start_has_come_by_a_parabola():
    gap_functions = GapFunctions(np.zeros(0), np.zeros(0), exact=True)
    gap, slope = lambda t: 1.0 - 2.0 * t - 3.0 * t**2, lambda t: -2.0 - 6.0 * t
    gap_functions.add(1.0, [Observation(-7, gap(1.0), slope(1.0), slope(0.0))])
    assert gap_functions.closing(0.0, 1.0) == pytest.approx(1.0 / 3.0, abs=1e-14)


def test_slopes_of_semi_implicit_steps_are_those_of_gaps_not_of_velocities():
    gap_functions = GapFunctions(np.array([1.0]), np.array([-1.0]), exact=False)
    gap, velocity = lambda t: 1.0 - t - 3.0 * t**2, lambda t: -1.0 - 3.0 * t  # q' = q + t v', v' = v + a t
    gap_functions.add(1.0, [Observation(0, gap(1.0), velocity(1.0), -1.0)])
    assert gap_functions.closing(0.0, 1.0) == pytest.approx((math.sqrt(13.0) - 1.0) / 6.0, abs=1e-14)


def test_gaps_of_semi_implicit_steps_are_found_in_a_few_flows():
    gap, velocity = lambda t: 1e-3 - 0.3 * t - 40.0 * t**2 - 2e4 * t**3, lambda t: -0.3 - 40.0 * t
    found, tried = located([gap], [velocity], 0.01, exact=False)
    assert abs(found.gap) <= 1e-11
    assert len(tried) <= 6


def test_gap_too_far_to_be_seen_at_the_start_is_found_from_where_it_was_seen():
    near, gap, slope = 1e-6, lambda t: 9e-6 - 0.33 * t - 20 * t**2, lambda t: -0.33 - 40 * t
    gap_functions, tried = GapFunctions(np.zeros(0), np.zeros(0), exact=True), []

    def advance_to_contact(time):
        tried.append(time)
        seen = gap(time) <= near
        # whatever body moved at the start
        observations = [Observation(-6, gap(time), slope(time), 0.1)] if seen else []
        return SimpleNamespace(duration=time, gap=gap(time) if seen else near, observations=observations)

    end = advance_to_contact(0.01)
    gap_functions.add(0.01, end.observations)
    options = {"target": 1e-11, "tolerance": 1e-9, "shortest": 1e-12}
    found = locate(advance_to_contact, end, gap_functions, **options)
    assert abs(found.gap) <= 1e-11
    assert len(tried) <= 7


def link(name, damping, limits, tip, more=""):
    """Return a rod along x that turns about y, with something at its tip."""
    joint = f'<joint name="{name}" axis="0 1 0" damping="{damping}" range="{limits}"/>'
    return f'{joint}<geom type="capsule" size=".03" fromto="0 0 0 {tip} 0 0"/>{more}'


HAND = link("hand", 0, "-25 10", 0.3)
FOREARM = link("elbow", 0.1, "-20 15", 0.3, f'<body pos=".3 0 0">{HAND}</body>')
ARM = f'<body pos="0 0 2">{link("shoulder", 0.2, "-30 20", 0.4, f"""<body pos=".4 0 0">{FOREARM}</body>""")}</body>'


@pytest.fixture
def phases(monkeypatch):
    """Return a list that gets the duration of every phase, in order."""
    durations, advance = [], SmoothPhases.advance

    def counted(self, duration, force=None, **options):
        durations.append(duration)
        advance(self, duration, force, **options)

    monkeypatch.setattr(SmoothPhases, "advance", counted)
    return durations


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
def test_limits_that_bounce_take_few_flows(phases, integrator):
    model, data = compiled(ARM, option=f'timestep="0.004" integrator="{integrator}"', geom='contype="0"')
    stepper, collisions = Stepper(model, Moreau(0.3)), 0
    for _ in range(120):
        stepper.step(data)
        collisions += len(stepper.events)
    assert collisions > 60
    assert len(phases) < 120 + 2 * collisions
    assert stepper.unlocated == 0


def test_flow_that_is_only_tried_is_not_given_its_last_velocity(monkeypatch):
    """A ball slides below an arm whose limits bounce: for a trial phase, one solve of the friction is enough."""
    solves, hold, solve = [], smooth_phase.hold, frictional.solve_cone_rows

    def held(*args):
        solves.append(0)
        return hold(*args)

    def solved(*args, **options):
        solves[-1] += 1
        return solve(*args, **options)

    monkeypatch.setattr(smooth_phase, "hold", held)
    monkeypatch.setattr(frictional, "solve_cone_rows", solved)
    ball = '<body pos="0 2 .1"><freejoint/><geom size=".1" contype="1" friction="0.1"/></body>'
    floor = '<geom type="plane" size="9 9 1" contype="1" friction="0.1"/>'
    model, data = compiled(ARM + ball + floor, option='timestep="0.004" integrator="RK4"', geom='contype="0"')
    data.joint(3).qvel[0] = 3.0
    stepper, collisions = Stepper(model, Moreau(0.3)), 0
    for _ in range(120):
        stepper.step(data)
        collisions += len(stepper.events)
    assert collisions > 30
    assert solves.count(1) > 10
    assert solves.count(0) == 0
    assert data.joint(3).qvel[0] == pytest.approx(3.0 - 0.1 * 9.81 * 120 * 0.004, abs=1e-9)
