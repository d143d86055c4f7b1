"""Shared by tests of time stepping: the floor and limits of their scenes, the stepper, the velocities at an impact."""

from impactlaw import Stepper

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'


def stepping(model, law, **options):
    return Stepper(model, law, scheme="time-stepping", **options)


def on_a_tendon(scene: str, joint: str, limits: str) -> str:
    """Return a scene with the limits of a joint on a tendon of the same length: those are never left out."""
    limit = f'limited="true" range="{limits}"'
    assert scene.count(limit) == 1
    fixed = f'<tendon><fixed {limit}><joint joint="{joint}" coef="1"/></fixed></tendon>'
    return scene.replace(limit, 'limited="false"').replace("</worldbody>", f"</worldbody>{fixed}")


def first_impact(stepper, data, most=2000):
    for _ in range(most):
        before = data.qvel.copy()
        stepper.step(data)
        if stepper.events:
            (event,) = stepper.events
            return before, event
    raise AssertionError("nothing collided")
