"""Shared by tests of time stepping: the floor of their scenes, the stepper, and the velocities at an impact."""

from impactlaw import Stepper

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'


def stepping(model, law, **options):
    return Stepper(model, law, scheme="time-stepping", **options)


def first_impact(stepper, data, most=2000):
    for _ in range(most):
        before = data.qvel.copy()
        stepper.step(data)
        if stepper.events:
            (event,) = stepper.events
            return before, event
    raise AssertionError("nothing collided")
