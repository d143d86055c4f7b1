"""Environments shared by tests of their laws."""

import gymnasium
import numpy as np
import pytest

from impactlaw.envs import ImpactLaw

JUGGLER = "impactlaw.envs:impactlaw/Juggler-v0"


def juggler(**options):
    return gymnasium.make(JUGGLER, **options)


def kept(env, steps=2000):
    """Return the part of its speed that each contact keeps in its next collision."""
    inner = env if isinstance(env, ImpactLaw) else env.unwrapped
    for _ in range(steps):
        env.step(np.zeros(env.action_space.shape))
        events = inner.events if isinstance(inner, ImpactLaw) else inner.stepper.events
        for event in events:
            impact = event.impact
            hit = impact.impulse > 1e-6
            if hit.any():
                c = impact.collision
                return -impact.post_contact_velocity[hit] / c.pre_contact_velocity[hit]
    raise AssertionError("nothing has collided")


def limp_hopper(**options):
    env = gymnasium.make("Hopper-v5", terminate_when_unhealthy=False)
    return ImpactLaw(env, "moreau", 0.5, **options)


MAKERS = {
    "own": lambda: juggler(frame_skip=1),
    "own, soft": lambda: juggler(contact_model="soft", frame_skip=1),
    "own, time stepping": lambda: juggler(scheme="time-stepping", frame_skip=1),
    "wrapped": limp_hopper,
    "wrapped, rigid": lambda: limp_hopper(contact_model="rigid"),
}
every_maker = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
